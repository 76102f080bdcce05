"""The prior of a lens's blur: its size, nearly round, and alike in both pictures."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array

# log sd of uu and vv, for lenses from .25 px (the pixel's own width) to 2 px; sd of uv
BLUR_MEAN_PX2, BLUR_LOG_SD = 0.6, 1.0
BLUR_SKEW_SD_PX2 = 0.15
# pairs alike in both pictures: uu and uu, vv and vv; pairs alike in one picture: uu and vv
BLUR_ALIKE, BLUR_ALIKE_SD_PX2 = ((0, 3), (2, 5)), 0.3
BLUR_ROUND = ((0, 2), (3, 5))
# deviation from a round blur, as a share of it, and at least, px^2; Cauchy, because motion blur is not round at all
BLUR_ROUND_SHARE, MIN_BLUR_ROUND_PX2 = 0.15, 0.15


def roundness(blur_px2: Array) -> tuple[Array, Array]:
    """(2,) each, by picture: the blur's (2, 3) deviation from round, and a lens's typical deviation, px^2."""
    wide = blur_px2[:, [0, 2]]
    return wide[:, 0] - wide[:, 1], np.maximum(BLUR_ROUND_SHARE * wide.mean(axis=1), MIN_BLUR_ROUND_PX2)


def roundness_cost(blur_px2: Array) -> float:
    """Minus the log likelihood of the blur's shape (2, 3), px^2, over both pictures."""
    off, scale = roundness(blur_px2)
    return float(np.sum(np.log1p((off / scale) ** 2)))


def blur_belief(blur_px2: Array) -> tuple[Array, Array]:
    """The prior of the blur, linearised at (2, 3) px^2: the inverse variance (6,), and the deviation from the prior
    (6,), px^2."""
    wide = blur_px2[:, [0, 2]]
    precision, off = np.empty((2, 3)), np.empty((2, 3))
    precision[:, [0, 2]] = (BLUR_LOG_SD * wide) ** -2.0
    off[:, [0, 2]] = wide * np.log(wide / BLUR_MEAN_PX2)
    precision[:, 1], off[:, 1] = BLUR_SKEW_SD_PX2**-2.0, blur_px2[:, 1]
    return precision.ravel(), off.ravel()
