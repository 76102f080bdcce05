"""What goes into one cycle of the loop, and what comes out of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Where the joints are to be in a cycle. Arrays (n,); a `pose_base_peg` of None keeps the last known."""

    joints_rad: Array
    speeds_rad_s: Array
    pose_base_peg: Pose | None = None
    retracing: bool = False  # the way back is not a way that was come
    tip_speed_m_s: float = 0.0  # of a motion that may touch: what it would still press if it were told to stop now


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """What is known after a cycle: the samples (m, 6) that came in it, their mean and what of it is contact, (6,)."""

    samples: Array
    raw: Array
    contact: Array
    force_n: float
    moment_nm: float
    joints_rad: Array  # (n,), as the encoders say


def finite_difference_speed(before_rad: Array, after_rad: Array, period_s: float) -> Array:
    """The speed (n,), rad/s, that takes joints from one cycle to the next."""
    return np.asarray((after_rad - before_rad) / period_s)
