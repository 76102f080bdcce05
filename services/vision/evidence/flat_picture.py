"""The other explanation of a rim: an outline printed in the face's plane, one step and no chamfer."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from services.vision.fit.climb import misfit
from services.vision.fit.rim import Rim
from services.vision.fit.solve import Doubts, Fit, Images, iterate
from services.vision.stereo import StereoModel

STEPS = 4
# a printed outline may be the outer one, the inner one, or lie between
LINE_SD_M = 1.0e-3


@dataclass(frozen=True, slots=True, eq=False)
class FlatPicture:
    """How well one step explains the pictures, against two: mean log misfit of either, and where that step lies, m
    outward of the drawing's outer line."""

    flat: float
    hole: float
    line_m: float
    pixels: float


def flat_picture(images: Images, coarse: Rim, stereo: StereoModel, fit: Fit) -> FlatPicture:
    """Both explanations at the same noise, from the same start."""
    doubts = Doubts()
    both = replace(fit.state, profile_weight=None)
    for _ in range(2):
        both, hole = iterate(images, coarse, stereo, both, doubts)
    flat_rim = replace(coarse, inner_m=coarse.outer_m)
    best: tuple[float, float] | None = None
    wide = replace(doubts, outer_sd_m=LINE_SD_M, inner_sd_m=1e-9)
    width = float(np.median(np.linalg.norm((coarse.outer_m - coarse.inner_m)[..., :2], axis=-1)))
    for line in (0.0, -0.5 * width, -width):
        one = replace(fit.state, sizes_m=np.array([line, 0.0, 0.0, 0.0]), chamfer_grey=None, profile_weight=None)
        for _ in range(STEPS):
            one, flat = iterate(images, flat_rim, stereo, one, wide)
        found = misfit(flat, hole.even), float(one.sizes_m[0] + np.mean(one.sizes_m[2:]))
        best = found if best is None or found < best else best
    assert best is not None
    return FlatPicture(best[0], misfit(hole, hole.even), best[1], float(hole.profiles.inside.sum()))
