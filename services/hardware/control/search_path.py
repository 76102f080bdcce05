"""A search path, sampled: what an admittance move adds to its yielding, cycle by cycle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import PathKnot

MIN_STEP_S = 0.001
LEVER_M = 0.03  # from the centre to a corner of the tip: how a turn moves what may touch


class SearchPath:
    """Velocities (n, 3) of the centre, m/s, across the push, and turning speeds (n, 3), rad/s, both in the base frame.

    With `stretch` it takes that many times as long.

    Raises CommandRefused path where the knots' times do not rise by a millisecond or more.
    """

    def __init__(
        self, knots: Sequence[PathKnot], rotation_base_peg: Array, direction_base: Array, period_s: float,
        stretch: float = 1.0,
    ) -> None:  # fmt: skip
        times = np.array([0.0, *(knot.time_s for knot in knots)])
        if np.any(np.diff(times) < MIN_STEP_S - 1e-9):
            raise CommandRefused("path", "path: the knots' time_s must rise by at least 1 ms from knot to knot")
        times = times * stretch
        self.steps = round(float(times[-1]) / period_s)
        offsets = np.array([[0.0, 0.0, 0.0], *(knot.offset_m for knot in knots)])
        turns = np.array([[0.0, 0.0, 0.0], *(knot.turn_rad for knot in knots)])
        at = np.arange(self.steps + 1) * period_s
        across = offsets @ rotation_base_peg.T
        across = across - np.outer(across @ direction_base, direction_base)
        places = np.column_stack([np.interp(at, times, across[:, axis]) for axis in range(3)])
        self.velocity_m_s: Array = np.diff(places, axis=0) / period_s
        turned = Rotation.from_rotvec(
            np.column_stack([np.interp(at, times, turns[:, axis]) for axis in range(3)]) @ rotation_base_peg.T
        )
        self.turn_rad_s: Array = np.zeros((0, 3))
        if self.steps:
            self.turn_rad_s = (turned[1:] * turned[:-1].inv()).as_rotvec() / period_s
        speeds = np.linalg.norm(self.velocity_m_s, axis=1)
        turning = np.linalg.norm(self.turn_rad_s, axis=1) if self.steps else speeds
        self.fastest_m_s = float((speeds + LEVER_M * turning).max()) if self.steps else 0.0
