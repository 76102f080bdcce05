"""What a file keeps of a peg, to tell later whether it is the same one: by its contour, whatever its name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from shapely import LinearRing

from crosspih_common.shapes.peg import Peg

SAME_CONTOUR_M = 6e-5
SAME_LENGTH_M = 1e-5
_LENGTHS = ("body_start_m", "taper_start_m", "apex_m", "tip_m")


def peg_as_data(peg: Peg) -> dict[str, Any]:
    """The peg's name, its corners and its lengths, as plain data."""
    corners = [[round(float(x), 9), round(float(y), 9)] for x, y in peg.outline.corners_m]
    return {"outline": peg.outline.name, "corners_m": corners, **{name: float(getattr(peg, name)) for name in _LENGTHS}}


def is_same_peg(said: Mapping[str, Any], peg: Peg) -> bool:
    """Whether `peg_as_data` was told of this peg. Raises ValueError, TypeError or KeyError where it is none of that."""
    lengths = np.array([float(said[name]) - float(getattr(peg, name)) for name in _LENGTHS])
    then, now = LinearRing(np.asarray(said["corners_m"], dtype=float)), LinearRing(peg.outline.corners_m)
    return bool(np.max(np.abs(lengths)) < SAME_LENGTH_M and then.hausdorff_distance(now) < SAME_CONTOUR_M)
