"""What the control layer keeps to, whatever it is told: the `hardware.limits` section of a cell's file."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config.section import Section


class LimitsConfig(Section):
    """Caps, what they are derived from, and what ends a motion. docs/safety.md has the derivation."""

    force_cap_n: float = Field(default=60.0, gt=0.0, le=500.0, description="|F| of contact at which the arm backs off")
    moment_cap_nm: float = Field(default=6.0, gt=0.0, le=50.0, description="|M| about the peg frame's origin, likewise")
    # how hard a peg lands: v sqrt(k m). Measured by `crosspih bench caps`, on a real cell by `crosspih cell check`.
    moved_mass_kg: float = Field(
        default=7.3, gt=0.0, le=200.0, description="what of the arm and its tool stops with the tip that hits"
    )
    contact_stiffness_n_m: float = Field(
        default=7.3e6, gt=1e3, le=1e9, description="of a hard contact: peg, plate and what holds them, in series"
    )
    sensor_delay_s: float = Field(
        default=0.002, ge=0.0, le=0.05, description="from a force to its sample in the loop: filter and transport"
    )
    braking_m_s2: float = Field(default=5.0, gt=0.05, le=50.0, description="how fast the tip slows down at contact")
    free_braking_m_s2: float = Field(
        default=1.0, gt=0.05, le=50.0, description="how fast a free move slows down as it nears the fixture"
    )
    clear_out_m_s: float = Field(
        default=0.03, gt=0.0, le=0.25, description="straight back along the peg's axis: nothing stands behind it"
    )
    holder_timeout_s: float = Field(
        default=0.1, ge=0.02, le=5.0, description="without a beat of its holder for so long the arm stops"
    )
    sensor_timeout_s: float = Field(
        default=0.05, gt=0.0, le=1.0, description="without a sample for so long the arm stops"
    )
    missed_cycles: int = Field(default=20, ge=1, le=10000, description="of one motion; with more of them the arm stops")
    motion_s: float = Field(default=120.0, gt=0.0, le=600.0, description="longest motion that is accepted")
