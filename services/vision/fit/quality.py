"""Figures of merit of a fit that do not depend on the light: all are relative to the height of the step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.rim import Rim
from services.vision.fit.solve import COMMON, POSE, Doubts, Fit, parameters
from services.vision.fit.steps import SATURATED_GREY

# a step counts as seen above this many noises of the mean of ALONG neighbours
STEP_NOISES, ALONG = 4.0, 5
MIN_STEP_SHARE = 0.15
MIN_WEIGHT = 0.3
# samples of a profile that remain when others are saturated or beyond the border
SEEN_SAMPLES = 5
TINY = 1e-9
MAX_ALIKE, ROUGH_FREE = 0.8, 0.03
# deviations below the root of this share of a prior sd are no conflict, however little the pictures say: for the sizes,
# and for the offset
MIN_SIZES, MIN_OFFSET = 0.1, 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Quality:
    """step_grey: median height of the step at the rim; noise_grey, face_grey: median; support (2, G): share of each
    group's profiles that look like the rim; residual: rms residual, share of the step; inside: share of the rim inside
    the picture, the smaller of both; saturated: share of the face beside the rim; rim_saturated: share of the profiles
    across it with any saturated part; inside_saturated: share of the inside next to it; offset_px (2,) and its conflict
    with the calibration (chi2, 2 dof); sizes_m (4,) (outer, inner, near, far) and their conflict with the drawing
    (chi2, 4 dof); rough: unexplained texture, share of the step, larger if it is correlated along the rim."""

    step_grey: float
    noise_grey: float
    face_grey: float
    support: Array
    residual: float
    inside: float
    saturated: float
    rim_saturated: float
    inside_saturated: float
    offset_px: Array
    offset_conflict: float
    sizes_m: Array
    sizes_conflict: float
    rough: float

    @property
    def supported(self) -> float:
        """Share of the profiles of both pictures."""
        return float(self.support.mean())


def _along(values: Array) -> Array:
    """(2, G, S): the mean of each with its neighbours along the rim, in its group."""
    half = ALONG // 2
    padded = np.pad(values, ((0, 0), (0, 0), (half, half)), mode="edge")
    return np.asarray(np.mean([padded[..., k : k + values.shape[2]] for k in range(ALONG)], axis=0))


def roughness_of(fit: Fit) -> float:
    """Unexplained texture, share of the step, larger if it is correlated along the rim."""
    # an object that covers the rim is no texture: the weights of the fit apply here, too
    counted = np.sqrt(fit.weight * fit.even[..., None, None])
    steps, rest = fit.steps, fit.steps.residual * counted
    height = np.maximum(np.abs(steps.chamfer - steps.face), np.abs(steps.bore - steps.face))
    typical = float(np.median(height)) + 1.0
    share = float(np.sqrt(np.sum(fit.weight * steps.residual**2) / max(float(np.sum(fit.weight)), TINY))) / typical
    alike = float(np.sum(rest[:, :, 1:] * rest[:, :, :-1]) / max(float(np.sum(rest**2)), TINY))
    alike = float(np.clip(alike, 0.0, MAX_ALIKE))
    return max(share * (1.0 + alike) / (1.0 - alike) - ROUGH_FREE, 0.0)


def _conflict(mean: Array, posterior: Array, prior_sd: Array, least: float) -> float:
    """The squared shift of the priors by the pictures, over its variance."""
    spread = np.diag(prior_sd**2) - posterior
    spread = spread + least * np.diag(prior_sd**2)
    return max(float(mean @ np.linalg.solve(spread, mean)), 0.0)


def _heights_of(fit: Fit) -> Array:
    """(2, G, S): height of the whole step or its larger part, grey, averaged over neighbours."""
    steps = fit.steps
    rises = (steps.chamfer - steps.face, steps.bore - steps.face, steps.bore - steps.chamfer)
    return np.asarray(np.max(np.abs([_along(rise) for rise in rises]), axis=0))


def support_of(fit: Fit) -> tuple[Array, Array]:
    """(2, G) each: the share of each group's profiles that look like the rim; and the share among those that can show
    it: inside the picture, and not saturated from within."""
    height, inside = _heights_of(fit), fit.profiles.inside
    noise = np.sqrt(np.median(fit.variance, axis=-1))
    least = STEP_NOISES * noise / np.sqrt(np.clip(ALONG * np.median(fit.seen.spacing_px), 1.0, ALONG))
    weight = fit.weight * fit.even[..., None, None]
    kept = weight.sum(axis=-1) / np.maximum(inside.sum(axis=-1), 1.0)
    seen = inside.sum(axis=-1) >= SEEN_SAMPLES
    ok = (height > least) & (height > MIN_STEP_SHARE * float(np.median(height))) & (kept > MIN_WEIGHT) & seen
    white = fit.profiles.grey > SATURATED_GREY
    whole = seen & (~np.any(white, axis=-1) | white[..., 0])
    return np.asarray(ok.mean(axis=2)), np.asarray(whole.mean(axis=2))


def quality_of(fit: Fit, rim: Rim, doubts: Doubts) -> Quality:
    """The figures of a fit at its end."""
    steps, inside = fit.steps, fit.profiles.inside
    typical = float(np.median(_heights_of(fit)))
    noise = np.sqrt(np.median(fit.variance, axis=-1))
    weight = fit.weight * fit.even[..., None, None]
    seen = inside.sum(axis=-1) >= SEEN_SAMPLES
    squares = np.sum(weight * steps.residual**2) / max(float(weight.sum()), 1.0)
    kinds = parameters(rim)[2]
    offset, sizes = kinds["offset"], slice(POSE, COMMON)
    off = fit.effects[offset]
    offset_sd = np.full(2, doubts.offset_sd_px)
    return Quality(
        typical,
        float(np.median(noise)),
        float(np.median(steps.face)),
        support_of(fit)[0],
        float(np.sqrt(squares)) / max(typical, 1.0),
        float(np.mean(seen, axis=(1, 2)).min()),
        float(np.mean(fit.profiles.grey[..., 0] > SATURATED_GREY)),
        float(np.mean(np.any(fit.profiles.grey > SATURATED_GREY, axis=-1))),
        float(np.mean(fit.profiles.beyond > SATURATED_GREY)),
        off,
        _conflict(off, fit.covariance[offset, offset], offset_sd, MIN_OFFSET),
        fit.state.sizes_m,
        _conflict(fit.state.sizes_m, fit.covariance[sizes, sizes], doubts.sds(), MIN_SIZES),
        roughness_of(fit),
    )
