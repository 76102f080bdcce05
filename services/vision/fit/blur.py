"""What is believed of a lens's blur before a picture is seen: some size, round, and alike in both pictures."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array

# of uu and vv the logarithm's sd: lenses from .25 px, the pixel's own width, to 2; of uv the sd
BLUR_MEAN_PX2, BLUR_LOG_SD = 0.6, 1.0
BLUR_SKEW_SD_PX2 = 0.15
# uu and uu of both pictures, vv and vv of both; uu and vv of one
BLUR_ALIKE, BLUR_ALIKE_SD_PX2 = ((0, 3), (2, 5)), 0.3
BLUR_ROUND = ((0, 2), (3, 5))
# by how much a lens is not round, of the blur, or px^2 at least; a Cauchy's: a dragged picture is not round at all
BLUR_ROUND_SHARE, MIN_BLUR_ROUND_PX2 = 0.15, 0.15


def roundness(blur_px2: Array) -> tuple[Array, Array]:
    """(2,) each, by picture: how far the blur (2, 3) is from round, and how far a lens usually is, px^2."""
    wide = blur_px2[:, [0, 2]]
    return wide[:, 0] - wide[:, 1], np.maximum(BLUR_ROUND_SHARE * wide.mean(axis=1), MIN_BLUR_ROUND_PX2)


def roundness_cost(blur_px2: Array) -> float:
    """How unlikely the shape of the blur (2, 3), px^2, is for a lens: minus the log likelihood of both pictures."""
    off, scale = roundness(blur_px2)
    return float(np.sum(np.log1p((off / scale) ** 2)))


def blur_belief(blur_px2: Array) -> tuple[Array, Array]:
    """What is believed of the blur before a picture is seen, about where it stands, (2, 3) px^2: one over the variance
    (6,), and how far it is off, px^2."""
    wide = blur_px2[:, [0, 2]]
    precision, off = np.empty((2, 3)), np.empty((2, 3))
    precision[:, [0, 2]] = (BLUR_LOG_SD * wide) ** -2.0
    off[:, [0, 2]] = wide * np.log(wide / BLUR_MEAN_PX2)
    precision[:, 1], off[:, 1] = BLUR_SKEW_SD_PX2**-2.0, blur_px2[:, 1]
    return precision.ravel(), off.ravel()
