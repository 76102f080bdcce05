"""What goes into one cycle of the loop, and what comes out of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rows import Rows

Wrench6 = tuple[float, float, float, float, float, float]

# Both are made anew in every cycle, and nobody writes to them; to freeze a dataclass makes each field of it several
# times as dear.


@dataclass(slots=True, eq=False)
class Reference:
    """Where the joints are to be in a cycle. Arrays (n,); a `rotation_base_peg` of None keeps the last known."""

    joints_rad: Array
    speeds_rad_s: Array
    rotation_base_peg: Rows | None = None
    retracing: bool = False  # the way back is not a way that was come
    tip_speed_m_s: float = 0.0  # of a motion that may touch: what it would still press if it were told to stop now


@dataclass(slots=True, eq=False)
class CycleReading:
    """What is known after a cycle: the samples (m, 6) that came in it, their mean (6,) and what of it is contact, six
    plain floats."""

    samples: Array
    raw: Array
    contact: Wrench6
    force_n: float
    moment_nm: float
    joints_rad: Array  # (n,), as the encoders say


def finite_difference_speed(before_rad: Array, after_rad: Array, period_s: float) -> Array:
    """The speed (n,), rad/s, that takes joints from one cycle to the next."""
    return np.asarray((after_rad - before_rad) / period_s)
