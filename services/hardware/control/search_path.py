"""A search path, sampled: what an admittance move adds to its yielding, millisecond by millisecond."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import PathKnot
from services.hardware.drivers.simulated.engines.pybullet.engine import STEP_S


class SearchPath:
    """Velocities (n, 3) of the centre, m/s, across the push, and turning speeds (n, 3), rad/s, both in the base frame.

    Raises CommandRefused path where the knots' times do not rise by a millisecond or more.
    """

    def __init__(self, knots: Sequence[PathKnot], rotation_base_peg: Array, direction_base: Array) -> None:
        times = np.array([0.0, *(knot.time_s for knot in knots)])
        if np.any(np.diff(times) < STEP_S - 1e-9):
            raise CommandRefused("path", "path: the knots' time_s must rise by at least 1 ms from knot to knot")
        self.steps = round(float(times[-1]) / STEP_S)
        offsets = np.array([[0.0, 0.0, 0.0], *(knot.offset_m for knot in knots)])
        turns = np.array([[0.0, 0.0, 0.0], *(knot.turn_rad for knot in knots)])
        at = np.arange(self.steps + 1) * STEP_S
        across = offsets @ rotation_base_peg.T
        across = across - np.outer(across @ direction_base, direction_base)
        places = np.column_stack([np.interp(at, times, across[:, axis]) for axis in range(3)])
        self.velocity_m_s: Array = np.diff(places, axis=0) / STEP_S
        turned = Rotation.from_rotvec(
            np.column_stack([np.interp(at, times, turns[:, axis]) for axis in range(3)]) @ rotation_base_peg.T
        )
        self.turn_rad_s: Array = np.zeros((0, 3))
        if self.steps:
            self.turn_rad_s = (turned[1:] * turned[:-1].inv()).as_rotvec() / STEP_S
        speeds = np.linalg.norm(self.velocity_m_s, axis=1)
        self.fastest_m_s = float(speeds.max()) if self.steps else 0.0
