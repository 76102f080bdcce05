"""The view points of the page: the first one on a cell, and the others to choose from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array
from services.viewer.bodies import upwards


@dataclass(frozen=True, slots=True, eq=False)
class ViewPoint:
    """The position of the eye, the point that it looks at, and the upward direction: each (3,), m, base frame."""

    eye_m: Array
    target_m: Array
    up: Array


def view_points(workcell: Workcell, offset_m: Array | None = None) -> dict[str, ViewPoint]:
    """The view points by name; the first one is the page's first. `offset_m` (3,) moves them with the cell."""
    up = upwards(workcell)
    hole = workcell.hole_prior.pose_base_hole()
    into = hole.rotation[:, 2]
    level = into - up * float(into @ up)
    if np.linalg.norm(level) < 0.3:  # the hole opens upwards: look from where the arm stands
        level = hole.translation_m - up * float(hole.translation_m @ up)
    level /= np.linalg.norm(level)
    side = np.cross(up, level)
    if float(side @ hole.translation_m) < 0.0:
        side = -side
    reach = float(np.linalg.norm(hole.translation_m))
    middle = hole.translation_m * 0.5 + up * (0.22 * reach + 0.08)
    size = 0.55 + 1.05 * reach
    rim = hole.translation_m
    points = {
        "cell": ViewPoint(middle + size * (1.0 * side - 0.75 * level + 0.42 * up), middle, up),
        "hole": ViewPoint(rim + 0.30 * side - 0.24 * level + 0.16 * up, rim - 0.03 * into, up),
        "side": ViewPoint(rim + 0.42 * side - 0.02 * level + 0.03 * up, rim - 0.03 * into, up),
        "along": ViewPoint(rim - 0.34 * into + 0.14 * up + 0.10 * side, rim, up),
    }
    moved = np.zeros(3) if offset_m is None else offset_m
    return {name: ViewPoint(one.eye_m + moved, one.target_m + moved, up) for name, one in points.items()}
