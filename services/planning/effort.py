"""What an assembly cost, summed over its motions."""

from __future__ import annotations

from dataclasses import dataclass

from crosspih_common.messages import MotionOutcome


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
        """One motion more."""
        self.tip_path_m += outcome.tip_path_m
        self.moving_s += outcome.moving_s
        self.jerk_integral_m_s2 += outcome.jerk_integral_m_s2
        self.contact_s += outcome.contact_s
        self.contact_impulse_n_s += outcome.contact_impulse_n_s
        self.over_20_n_s += outcome.over_20_n_s

    def forget_forces(self) -> None:
        """What was felt so far was the tool's own weight."""
        self.contact_s = self.contact_impulse_n_s = self.over_20_n_s = 0.0
