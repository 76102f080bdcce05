"""What the pictures scatter by near the rim, measured from the fit's own residuals: by grey, texture and all."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.medians import median, median_of_last

BINS = 6
THIN = 3  # neighbours along a profile are half a pixel apart
QUANTISED_GREY = 0.29
# what a profile may be off by beside the noise and still count in full, share of the step
STEP_SHARE = 0.1
# times the median step: a glint is no licence
MAX_STEP = 2.0
# and the model itself, one sd, share of the step
MODEL_SHARE = 0.04
# where a chamfer shines, brighter than the face, the shine is not where the drawing's lines are: more of that
GLINT_SHARE = 0.1
DEGREES = 4.0
# a profile that leaves so much of what it shows unexplained, noise aside, is half a rim: something covers it
UNLIKE_SHARE = 0.15
# where most are worse, as at a start, that many times what the median leaves
UNLIKE_MEDIAN = 2.0
GROUP_POWER = 1.0  # how much an edge of which a part is covered is doubted as a whole
TINY = 1e-9


def variance_by_grey(
    model: Array, residual: Array, inside: Array, known: Array | None = None, floor: float = QUANTISED_GREY
) -> Array:
    """(2, G, S, L): the residuals' variance at the grey that the model gives, robust, straight between bins of grey.

    `known` (2, G, S): how much each profile counted before: what covers the rim has another scatter than the rim."""
    out = np.empty_like(model)
    for side in range(2):
        use = inside[side] > 0
        if known is not None:
            use &= (known[side] >= 0.5 * median(known[side]))[..., None]
        grey, error = model[side][use][::THIN], np.abs(residual[side][use][::THIN])
        if grey.size < 4 * BINS:
            out[side] = floor**2
            continue
        # as many in each bin, the few that are left over among the darkest dropped
        order = np.argsort(grey)[grey.size % BINS :].reshape(BINS, -1)
        # of a profile of some 12 samples two or three went into its own greys
        values = np.maximum(1.15 * 1.4826 * median_of_last(error[order]), floor) ** 2
        out[side] = np.interp(model[side], grey[order[:, order.shape[1] // 2]], values)
    return out


def likeness(model: Array, residual: Array, variance: Array, inside: Array) -> Array:
    """(2, G, S): 1 for a profile that looks like a rim, less the more of what it shows is left unexplained."""
    count = np.maximum(inside.sum(axis=-1), 1.0)
    level = np.sum(model * inside, axis=-1) / count
    noise = np.sum(variance * inside, axis=-1)
    shown = np.sum((model - level[..., None]) ** 2 * inside, axis=-1) + noise
    left = np.maximum(np.sum(residual**2 * inside, axis=-1) - noise, 0.0) / np.maximum(shown, TINY)
    most = np.maximum(UNLIKE_SHARE, UNLIKE_MEDIAN * median_of_last(left.reshape(2, -1)))[:, None, None]
    like = 1.0 / (1.0 + (left / most) ** 2)
    # what covers a part of an edge may look like a rim elsewhere along it
    return np.asarray(like * np.mean(like, axis=2, keepdims=True) ** GROUP_POWER)


def robust_weight(
    model: Array, residual: Array, variance: Array, step: Array, inside: Array, glint: Array
) -> tuple[Array, Array, Array]:
    """One over the variance, less where a sample or its whole profile lies far out (Student's t), or does not look like
    a rim; and how much of each profile (2, G, S) counts, and the variance that a group (2, G) is taken to have.

    `step` (2, G, S): height of the whole step, grey; `glint` (2, G): how much brighter than the face a chamfer shines,
    0 to 1, by the face's grey.
    """
    usual = median_of_last(step.reshape(2, -1))[:, None, None]
    scale = variance + (STEP_SHARE * np.minimum(step, MAX_STEP * usual)[..., None]) ** 2
    square = residual**2 / scale
    one = (DEGREES + 1.0) / (DEGREES + square)
    count = np.maximum(inside.sum(axis=-1), 1.0)
    mean = np.sum(square * inside, axis=-1) / count
    whole = (DEGREES + 1.0) / (DEGREES + np.maximum(mean, 1.0))
    # one weight a group: a dark bore with little noise knows no better where the edge lies than the model is true
    level = np.sum(variance * inside, axis=(2, 3)) / np.maximum(inside.sum(axis=(2, 3)), 1.0)
    height = np.mean(step**2, axis=2)
    doubt = MODEL_SHARE**2 + (GLINT_SHARE * glint) ** 2
    even = np.maximum(level + doubt * height, QUANTISED_GREY**2)[..., None, None]
    profile = np.minimum(whole, 1.0) ** 2 * likeness(model, residual, variance, inside)
    return inside * np.minimum(one, 1.0) * profile[..., None] / even, profile, even[..., 0, 0]
