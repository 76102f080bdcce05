"""What the pictures scatter by near the rim, measured from the fit's own residuals: by grey, texture and all."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array

BINS = 6
THIN = 3  # neighbours along a profile are half a pixel apart
QUANTISED_GREY = 0.29
# what a profile may be off by beside the noise and still count in full, share of the step
STEP_SHARE = 0.1
# and the model itself, one sd, share of the step
MODEL_SHARE = 0.04
DEGREES = 4.0


def variance_by_grey(model: Array, residual: Array, inside: Array, floor: float = QUANTISED_GREY) -> Array:
    """(2, G, S, L): the residuals' variance at the grey that the model gives, robust, straight between bins of grey."""
    out = np.empty_like(model)
    for side in range(2):
        use = inside[side] > 0
        grey, error = model[side][use][::THIN], np.abs(residual[side][use][::THIN])
        if grey.size < 4 * BINS:
            out[side] = floor**2
            continue
        parts = np.array_split(np.argsort(grey), BINS)
        # of a profile of some 12 samples two or three went into its own greys
        values = [max(1.15 * 1.4826 * float(np.median(error[part])), floor) ** 2 for part in parts]
        centres = [float(np.median(grey[part])) for part in parts]
        out[side] = np.interp(model[side], centres, values)
    return out


def robust_weight(residual: Array, variance: Array, step: Array, inside: Array) -> tuple[Array, Array, Array]:
    """One over the variance, less where a sample or its whole profile lies far out (Student's t); and how much of each
    profile (2, G, S) counts, and the variance that a group (2, G) is taken to have.

    `step` (2, G, S): height of the whole step, grey.
    """
    scale = variance + (STEP_SHARE * step[..., None]) ** 2
    square = residual**2 / scale
    one = (DEGREES + 1.0) / (DEGREES + square)
    count = np.maximum(inside.sum(axis=-1), 1.0)
    mean = np.sum(square * inside, axis=-1) / count
    whole = (DEGREES + 1.0) / (DEGREES + np.maximum(mean, 1.0))
    # one weight a group: a dark bore with little noise knows no better where the edge lies than the model is true
    level = np.sum(variance * inside, axis=(2, 3)) / np.maximum(inside.sum(axis=(2, 3)), 1.0)
    height = np.mean(step**2, axis=2)
    even = np.maximum(level + MODEL_SHARE**2 * height, QUANTISED_GREY**2)[..., None, None]
    profile = np.minimum(whole, 1.0) ** 2
    return inside * np.minimum(one, 1.0) * profile[..., None] / even, profile, even[..., 0, 0]
