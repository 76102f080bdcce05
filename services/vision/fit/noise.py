"""The noise of the pictures near the rim, measured from the residuals of the fit: by grey, with the texture."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.medians import median, median_of_last

BINS = 6
THIN = 3  # neighbours along a profile are half a pixel apart
QUANTISED_GREY = 0.29
# deviation of a profile beyond the noise that still counts in full, share of the step
STEP_SHARE = 0.1
# upper limit of that step, in median steps, so that a glint does not widen the tolerance
MAX_STEP = 2.0
# model error, one sd, share of the step
MODEL_SHARE = 0.04
# added model error where a chamfer shines brighter than the face: the shine does not follow the drawing's lines
GLINT_SHARE = 0.1
DEGREES = 4.0
# a profile with this unexplained share, without the noise, counts as half a rim: something covers it
UNLIKE_SHARE = 0.15
# if most profiles are worse, as at a start: this many medians of the unexplained share
UNLIKE_MEDIAN = 2.0
GROUP_POWER = 1.0  # how strongly a partly covered edge is down-weighted as a whole
TINY = 1e-9


def variance_by_grey(
    model: Array, residual: Array, inside: Array, known: Array | None = None, floor: float = QUANTISED_GREY
) -> Array:
    """(2, G, S, L): the robust variance of the residuals at the model's grey, grey^2, linear between bins of grey.

    `known` (2, G, S): the weight of each profile before; an object that covers the rim scatters differently."""
    out = np.empty_like(model)
    for side in range(2):
        use = inside[side] > 0
        if known is not None:
            use &= (known[side] >= 0.5 * median(known[side]))[..., None]
        grey, error = model[side][use][::THIN], np.abs(residual[side][use][::THIN])
        if grey.size < 4 * BINS:
            out[side] = floor**2
            continue
        # equal counts in each bin; the few darkest left over are dropped
        order = np.argsort(grey)[grey.size % BINS :].reshape(BINS, -1)
        # two or three degrees of freedom of a profile's 12 samples are spent on its own greys
        values = np.maximum(1.15 * 1.4826 * median_of_last(error[order]), floor) ** 2
        out[side] = np.interp(model[side], grey[order[:, order.shape[1] // 2]], values)
    return out


def likeness(model: Array, residual: Array, variance: Array, inside: Array) -> Array:
    """(2, G, S): 1 for a profile that looks like a rim, lower with its unexplained share."""
    count = np.maximum(inside.sum(axis=-1), 1.0)
    level = np.sum(model * inside, axis=-1) / count
    noise = np.sum(variance * inside, axis=-1)
    shown = np.sum((model - level[..., None]) ** 2 * inside, axis=-1) + noise
    left = np.maximum(np.sum(residual**2 * inside, axis=-1) - noise, 0.0) / np.maximum(shown, TINY)
    most = np.maximum(UNLIKE_SHARE, UNLIKE_MEDIAN * median_of_last(left.reshape(2, -1)))[:, None, None]
    like = 1.0 / (1.0 + (left / most) ** 2)
    # an object that covers a part of an edge may look like a rim elsewhere along it
    return np.asarray(like * np.mean(like, axis=2, keepdims=True) ** GROUP_POWER)


def robust_weight(
    model: Array, residual: Array, variance: Array, step: Array, inside: Array, glint: Array
) -> tuple[Array, Array, Array]:
    """The inverse variance, lowered for samples and whole profiles that are outliers (Student's t) or do not look like
    a rim; the weight of each profile (2, G, S); and the variance used for each group (2, G).

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
    # one weight per group: the low noise of a dark bore does not make the model more accurate there
    level = np.sum(variance * inside, axis=(2, 3)) / np.maximum(inside.sum(axis=(2, 3)), 1.0)
    height = np.mean(step**2, axis=2)
    doubt = MODEL_SHARE**2 + (GLINT_SHARE * glint) ** 2
    even = np.maximum(level + doubt * height, QUANTISED_GREY**2)[..., None, None]
    profile = np.minimum(whole, 1.0) ** 2 * likeness(model, residual, variance, inside)
    return inside * np.minimum(one, 1.0) * profile[..., None] / even, profile, even[..., 0, 0]
