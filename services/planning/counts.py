"""The counts of an assembly: its motions and their effort."""

from __future__ import annotations

from dataclasses import dataclass, field

from crosspih_common.messages import MotionOutcome, StopReason

CAPPED = (StopReason.FORCE_CAP, StopReason.MOMENT_CAP)


@dataclass(slots=True)
class Effort:
    """Sums over the motions of one assembly, named as in AssemblyResult."""

    tip_path_m: float = 0.0
    moving_s: float = 0.0
    jerk_integral_m_s2: float = 0.0
    contact_s: float = 0.0
    contact_impulse_n_s: float = 0.0
    over_20_n_s: float = 0.0

    def add(self, outcome: MotionOutcome) -> None:
        """Add a motion."""
        self.tip_path_m += outcome.tip_path_m
        self.moving_s += outcome.moving_s
        self.jerk_integral_m_s2 += outcome.jerk_integral_m_s2
        self.contact_s += outcome.contact_s
        self.contact_impulse_n_s += outcome.contact_impulse_n_s
        self.over_20_n_s += outcome.over_20_n_s

    def forget_forces(self) -> None:
        """What was felt so far was the tool's own weight."""
        self.contact_s = self.contact_impulse_n_s = self.over_20_n_s = 0.0


@dataclass(slots=True)
class AssemblyCounts:
    """Of one assembly: attempts, pushes, corrections, motions that the cell's caps stopped, time and peaks."""

    attempt: int = 0
    pushes: int = 0
    corrections: int = 0
    overloads: int = 0
    motion_s: float = 0.0
    peak_force_n: float = 0.0
    peak_moment_nm: float = 0.0
    effort: Effort = field(default_factory=Effort)

    def add(self, outcome: MotionOutcome) -> None:
        """Add a motion."""
        self.effort.add(outcome)
        self.motion_s += outcome.duration_s
        self.peak_force_n = max(self.peak_force_n, outcome.peak_force_n)
        self.peak_moment_nm = max(self.peak_moment_nm, outcome.peak_moment_nm)
        self.overloads += outcome.stop_reason in CAPPED

    def forget_forces(self) -> None:
        """What was felt so far was no contact: before it knew the payload the arm took the tool's weight for one."""
        self.peak_force_n = self.peak_moment_nm = 0.0
        self.effort.forget_forces()
