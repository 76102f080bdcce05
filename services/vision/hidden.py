"""Names the hidden parts of the rim by the axes of the drawing."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.rim import Rim

HIDDEN = 0.5  # share of an edge's profiles that look like the rim; below it the edge is hidden
ON_AXIS_RAD = np.deg2rad(32.0)  # angle from an axis; the sides of a cross's arm still count as on its axis
MAX_NAMED = 3
MOSTLY = 0.8
SIDES = ("left", "right")


def hidden_parts(support: Array, rim: Rim) -> str:
    """For instance "in the left picture the rim at +x and -y"; empty where no edge is hidden. `support` (2, G): share
    of each edge's profiles that look like the rim, left and right; x and y are the hole's own, as in the drawing."""
    said = []
    places = np.array([_place(*middle) for middle in rim.outer_m[..., :2].mean(axis=1)])
    for side, row in zip(SIDES, support, strict=True):
        hidden = row < HIDDEN
        if hidden.mean() > MOSTLY:
            said.append(f"in the {side} picture nearly all of it")
        elif hidden.any():
            names, counts = np.unique(places[hidden], return_counts=True)
            worst = [str(names[index]) for index in np.argsort(-counts, kind="stable")[:MAX_NAMED]]
            said.append(f"in the {side} picture the rim at {_listed(worst)}")
    return ", ".join(said)


def _place(x_m: float, y_m: float) -> str:
    """The direction of a place from the hole's axis: +x, -y, +x+y, ..."""
    along_x, along_y = (np.arctan2(abs(across), abs(along)) < ON_AXIS_RAD for along, across in
                        ((x_m, y_m), (y_m, x_m)))  # fmt: skip
    signs = f"{'+' if x_m > 0.0 else '-'}x", f"{'+' if y_m > 0.0 else '-'}y"
    return signs[0] if along_x else signs[1] if along_y else "".join(signs)


def _listed(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
