"""Where the peg is touched, estimated from a wrench."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Peg

REACH_M = 0.15
STEPS = 601
MIN_FORCE_N = 0.8  # below it noise turns the line of action about


def contact_point(wrench_peg: ArrayLike, peg: Peg) -> Array | None:
    """Where the line of action of the force of a wrench (6,), N and Nm, in the peg frame enters the peg: (3,), m.

    That is the contact point, if there is one contact and friction makes no moment about its normal. With several
    contacts it lies between them. None where the force is too small, or its line misses the peg.
    """
    wrench = np.asarray(wrench_peg, float)
    force, moment = wrench[:3], wrench[3:]
    square = float(force @ force)
    if square < MIN_FORCE_N**2:
        return None
    nearest = np.cross(force, moment) / square
    along = np.linspace(-REACH_M, REACH_M, STEPS)
    points = nearest + along[:, None] * force / np.sqrt(square)
    z = points[:, 2]
    scale = np.maximum(peg.scale_at(z), 1e-6)
    inside = (z >= peg.body_start_m) & (z <= peg.tip_m)
    inside &= shapely.contains_xy(shapely.Polygon(peg.outline.corners_m), points[:, 0] / scale, points[:, 1] / scale)
    hits = np.flatnonzero(inside)
    return None if not len(hits) else np.asarray(points[hits[0]])
