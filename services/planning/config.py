"""The planning service's own settings."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config.section import Section


class PlanningConfig(Section):
    """The `planning` section of a cell's file."""

    strategies: tuple[str, ...] | None = Field(
        default=None,
        description="the strategies of one's own that may be loaded, module:Class each (docs/extending.md); where left "
        "out any, but in a cell with certificates none",
    )
    speed_scale: float = Field(default=0.5, gt=0.0, le=1.0, description="of the arm's joint speeds, in free space")
    acceleration_scale: float = Field(default=0.3, gt=0.0, le=1.0)
    line_speed_m_s: float = Field(default=0.15, gt=0.0, le=0.5, description="straight moves in free space")
    approach_m: float = Field(default=0.06, gt=0.0, description="where the straight approach begins, before the face")
    standoff_m: float = Field(default=0.004, gt=0.0, description="tip to face before a push or a touch")
    push_speed_m_s: float = Field(default=0.015, gt=0.0, le=0.1)
    push_force_n: float = Field(default=12.0, gt=0.0)
    push_timeout_s: float = Field(default=15.0, gt=0.0, description="a peg far askew creeps in for ten seconds")
    push_stall_s: float = Field(default=0.5, gt=0.0)
    extra_depth_m: float = Field(default=0.010, ge=0.0, description="beyond the wanted depth: vision's depth is vague")
    touch_speed_m_s: float = Field(default=0.01, gt=0.0, le=0.1)
    touch_creep_m_s: float = Field(default=0.001, gt=0.0, le=0.02)
    # stiff cells are touched more slowly (gentle.py), so that the force rises no further after the threshold
    touch_adds_n: float = Field(default=18.0, gt=0.0, description="by the creep while it is observed, at the most")
    touch_reaction_n: float = Field(default=15.0, gt=0.0, description="before a touch hears of the force, at the most")
    touch_threshold_n: float = Field(default=5.0, gt=0.0)
    touch_travel_m: float = Field(default=0.045, gt=0.0, description="felt nothing on this way: the hole is not there")
    probe_speed_m_s: float = Field(default=0.0055, gt=0.0, le=0.1, description="where the face may be: it is stiff")
    max_probes: int = Field(default=16, ge=1, le=100, description="places felt for the hole before giving up")
    narrow_lateral_m: float = Field(default=8e-4, gt=0.0, description="sd; a wider belief is touched, not pushed")
    narrow_rotation_rad: float = Field(default=0.03, gt=0.0, description="sd")
    narrow_residual: float = Field(default=12.0, gt=0.0, description="of the fit; about 5 when it is right")
    touches_a_push: int = Field(default=3, ge=1, description="after which a push is tried, however wide the belief")
    touch_clearance_m: float = Field(default=0.002, gt=0.0, description="how far a touch retreats")
    # once seated the peg is pressed against four walls of its bore, so that T2 is better than the clearance
    press_speed_m_s: float = Field(default=0.003, gt=0.0, le=0.02)
    press_creep_m_s: float = Field(default=4e-4, gt=0.0, le=0.02, description="a peg held at both ends is stiff")
    press_force_n: float = Field(default=4.0, gt=0.0)
    press_travel_m: float = Field(default=0.002, gt=0.0, le=0.01)
    max_attempts: int = Field(default=8, ge=1, le=50, description="pushes before giving up")
    max_advices: int = Field(default=3, ge=0, le=20, description="ways tried to free a peg that stalls in its bore")
    feel_when_unseen: bool = Field(default=True, description="vision refuses: the hole is felt for by force alone")
    max_overloads: int = Field(default=3, ge=1, description="stops by the force or moment cap before giving up")
    # the paper's loop: straight push at its own force, no yielding
    paper_speed_m_s: float = Field(default=0.005, gt=0.0, le=0.05)
    paper_threshold_n: float = Field(default=15.0, gt=0.0)
    paper_attempts: int = Field(default=10, ge=1, le=100)
    service_patience_s: float = Field(default=20.0, gt=0.0, description="wall time a lost service has to come back")
    # generous limits, not watchdogs: the link shows within a second that a service died or hangs, and a slow
    # machine is no reason to take the peg out
    answer_deadline_s: float = Field(default=600.0, gt=0.0, description="wall time a service that lives may think")
    motion_deadline_s: float = Field(default=900.0, gt=0.0, description="wall time a motion may take")
    calibration_dwell_s: float = Field(default=0.25, gt=0.0)
