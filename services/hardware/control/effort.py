"""What a motion cost, for scoring: how far the tip went, how smoothly, and how hard the peg was pressed.

Jerk is taken as the AI for Industry Challenge takes it (intrinsic-dev/aic, docs/scoring.md): at 500 Hz the velocity is
fitted by a quadratic over 15 samples (Savitzky and Golay 1964), whose second derivative is the jerk; only times in
which the tip is faster than 10 mm/s count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from crosspih_common.arm import ArmModel
from crosspih_common.geometry.pose import Array

SAMPLE_S = 0.002
WINDOW_S = 0.03
MOVING_M_S = 0.01
CONTACT_N = 2.0  # above the noise, and above what a gentle move feels of the payload's inertia
HEAVY_N = 20.0


@dataclass(frozen=True, slots=True)
class EffortFigures:
    """The figures of one motion, named as in MotionOutcome."""

    tip_path_m: float
    moving_s: float
    jerk_integral_m_s2: float
    contact_s: float
    contact_impulse_n_s: float
    over_20_n_s: float


class EffortMeter:
    """Collects a motion step by step; `figures` works it out at the end."""

    def __init__(self, arm: ArmModel, tip_flange_m: Array, step_s: float) -> None:
        self._arm, self._tip_flange_m, self._step_s = arm, tip_flange_m, step_s
        self._steps_a_sample = max(1, round(SAMPLE_S / step_s))
        self._joints: list[Array] = []
        self._force_n: list[float] = []

    def restart(self) -> None:
        """A new motion."""
        self._joints.clear()
        self._force_n.clear()

    def add(self, joints_rad: Array, force_n: float) -> None:
        """One step of the joints (n,) and the contact force felt in it."""
        if len(self._force_n) % self._steps_a_sample == 0:
            self._joints.append(joints_rad)
        self._force_n.append(force_n)

    def figures(self) -> EffortFigures:
        """Over all steps since the restart."""
        force = np.asarray(self._force_n)
        touching = force > CONTACT_N
        tips = self._arm.points_base_m(np.array(self._joints).reshape(-1, self._arm.joints), self._tip_flange_m)
        moving_s, jerk_integral = smoothness(tips, self._steps_a_sample * self._step_s)
        return EffortFigures(
            tip_path_m=float(np.linalg.norm(np.diff(tips, axis=0), axis=1).sum()),
            moving_s=moving_s,
            jerk_integral_m_s2=jerk_integral,
            contact_s=float(touching.sum() * self._step_s),
            contact_impulse_n_s=float(force[touching].sum() * self._step_s),
            over_20_n_s=float((force > HEAVY_N).sum() * self._step_s),
        )


def smoothness(positions_m: Array, period_s: float) -> tuple[float, float]:
    """(time in motion, s; integral of |jerk| over it, m/s^2) of positions (n, 3); zeros where n is below the window."""
    window = max(5, 2 * int(WINDOW_S / period_s / 2.0) + 1)
    if len(positions_m) <= window:
        return 0.0, 0.0
    velocity = np.diff(positions_m, axis=0) / period_s
    fitted = {
        order: np.linalg.norm(
            savgol_filter(velocity, window, 2, deriv=order, delta=period_s, axis=0, mode="interp"), axis=1
        )
        for order in (0, 2)
    }
    moving = fitted[0] > MOVING_M_S
    return float(moving.sum() * period_s), float(fitted[2][moving].sum() * period_s)
