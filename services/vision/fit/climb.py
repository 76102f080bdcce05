"""From a start to the best pose: wide valleys first, few profiles first, and the other places where a bright chamfer
and a dark one would look alike."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.fit.quality import quality_of, roughness_of
from services.vision.fit.rim import Rim, Rimmed, perturbed, seen
from services.vision.fit.solve import (
    GLOSS_MOST,
    Doubts,
    Fit,
    Images,
    State,
    believed,
    iterate,
    roundness_cost,
    start_state,
)
from services.vision.fit.steps import STEP_PX
from services.vision.stereo import StereoModel

FEW_PROFILES = 72
# blur added to the pictures, px^2, most steps with it, with few profiles, and how many times less likely than the best,
# by the logarithm, a start may be to be followed further
STAGES = ((1.0, 3, 1.6), (0.0, 3, 1.35))
FINE_STEPS = 5
# a chamfer that much brighter than the face, times, is no glint; more than that is no more of one; what it is worth
GLINT_FREE, GLINT_MOST, GLINT_GLOSS = 1.15, 1.5, 0.1
GLOSS_AT = 1  # the fine step after which shine and texture are measured
SETTLED_M, SETTLED_RAD = 6e-6, 6e-5
OTHER_STEPS, OTHER_HELD = 5, 3
# one chamfer as bright as the face (1), its opposite as dark as the bore (0): a rim moved by its width looks alike;
# from that difference on
BRIGHTER_LEAST = 0.5
# what is worse by less than that may be the better one with all profiles; so many are tried with them
ALIKE_SHARE, FINISHED = 1.2, 3
SAME_M = 0.05e-3
MARGIN_PX = 40
# a fit that pulls at the calibration or the drawing by more (chi2 of 2 and of 4) has perhaps gone astray
STRANGE_OFFSET, STRANGE_SIZES, STRANGE_LEAST = 3.0, 6.0, 0.1


def rims(hole: Rimmed) -> tuple[Rim, Rim]:
    """With few profiles, and with all."""
    return _rims_of(hole.inner_rim_m().tobytes(), hole.outer_rim_m().tobytes())


@dataclass(frozen=True, slots=True, eq=False)
class _Corners:
    inner: Array
    outer: Array

    def inner_rim_m(self) -> Array:
        return self.inner

    def outer_rim_m(self) -> Array:
        return self.outer


@lru_cache(maxsize=8)
def _rims_of(inner: bytes, outer: bytes) -> tuple[Rim, Rim]:
    hole = _Corners(*(np.frombuffer(corners).reshape(-1, 3) for corners in (inner, outer)))
    return Rim.of(hole, FEW_PROFILES), Rim.of(hole)


def _blurred(images: Images, variance_px2: float, rim: Rim, stereo: StereoModel, pose: Pose) -> Images:
    """Blurred about the rim only."""
    points = seen(rim, stereo, pose).outer_px.reshape(2, -1, 2)
    out = []
    for image, where in zip(images, points, strict=True):
        height, width = image.shape
        low = np.clip(np.floor(where.min(axis=0)) - MARGIN_PX, 0, [width - 1, height - 1]).astype(int)
        high = np.clip(np.ceil(where.max(axis=0)) + MARGIN_PX, 1, [width, height]).astype(int)
        blurred = image.copy()
        part = (slice(low[1], high[1]), slice(low[0], high[0]))
        blurred[part] = cv2.GaussianBlur(image[part], (0, 0), float(np.sqrt(variance_px2)))
        out.append(blurred)
    return out[0], out[1]


def _settled(before: State, after: State) -> bool:
    moved = before.pose_camera_hole.inverse() @ after.pose_camera_hole
    return bool(np.linalg.norm(moved.translation_m) < SETTLED_M and np.linalg.norm(moved.rotvec_rad()) < SETTLED_RAD)


def _same(one: State, other: State) -> bool:
    return one.pose_camera_hole.distance_to_m(other.pose_camera_hole) < SAME_M


def misfit(fit: Fit, even: Array) -> float:
    """Mean of log(1 + r^2 / (4 s^2)) over the samples: comparable between poses at one and the same `even`
    s^2 (2, G)."""
    inside = fit.profiles.inside
    square = fit.steps.residual**2 / even[..., None, None]
    return float(np.sum(np.log1p(0.25 * square) * inside) / max(float(inside.sum()), 1.0))


def unlikely(fit: Fit, even: Array, doubts: Doubts) -> float:
    """The misfit, and what an odd blur and odd sizes cost: minus the log likelihood a sample, but for a constant."""
    sizes = 0.5 * float(np.sum((fit.state.sizes_m / doubts.sds()) ** 2))
    # neighbours along a profile and along the rim see the same pixels
    independent = 2.0 * STEP_PX * float(np.mean(np.minimum(fit.seen.spacing_px, 1.0)))
    samples = max(float(fit.profiles.inside.sum()), 1.0)
    return misfit(fit, even) + (roundness_cost(fit.state) + sizes) / (independent * samples)


def gloss_of(fit: Fit) -> float:
    """How differently both cameras see the face beside the rim, as a share of its grey, its overall level aside."""
    face = np.maximum(fit.steps.face, 1.0)
    ratio = np.log(face[0] / face[1])
    # noise alone makes them differ too
    noise = np.sqrt(np.median(fit.variance) / 3.0) / np.maximum(np.median(face), 1.0)
    spread = float(np.median(np.abs(ratio - np.median(ratio))) * 1.4826)
    return float(np.sqrt(max(spread**2 - 2.0 * noise**2, 0.0)))


def glint_of(fit: Fit) -> float:
    """How much brighter than the face the brightest chamfers are, times the face's grey: broken edges shine as they
    do."""
    face = np.maximum(fit.steps.face.mean(axis=2), 1.0)
    brightest = float(np.quantile(fit.steps.chamfer.mean(axis=2) / face, 0.8))
    return float(np.clip(brightest - GLINT_FREE, 0.0, GLINT_MOST))


@dataclass(frozen=True, slots=True, eq=False)
class _Climbed:
    """Where few profiles led to: the state after the last step, and the look before it."""

    state: State
    fit: Fit


def climb(
    images: Images, coarse: Rim, fine: Rim, stereo: StereoModel, starts: Sequence[Pose], doubts: Doubts
) -> list[Fit]:
    """The fits from starts about one place, each within a pixel or two of the rim in both pictures; and others
    elsewhere, where few profiles do not tell which of them it is.

    Starts that led to one and the same place are followed once, and one that leaves far more unexplained than the best
    is given up: it is neither the best fit nor a rival of it.
    """
    states = [start_state(coarse, start) for start in starts]
    climbed: list[_Climbed] = []
    for extra, most, worse in STAGES:
        looked = images if extra == 0.0 else _blurred(images, extra, coarse, stereo, starts[0])
        climbed = []
        for state in states:
            with suppress(np.linalg.LinAlgError):
                climbed.append(_stage(looked, coarse, stereo, state, doubts, extra, most))
        climbed = _worth_following(climbed, doubts, worse)
        states = [one.state for one in climbed]
    if not climbed:
        return []
    climbed += _alike(images, coarse, stereo, climbed[0], doubts)
    fits = []
    for one in _worth_following(climbed, doubts, ALIKE_SHARE)[:FINISHED]:
        with suppress(np.linalg.LinAlgError):
            fits.append(finish(images, fine, stereo, glossed(one.state, one.fit), doubts))
    return fits


def _stage(
    images: Images, rim: Rim, stereo: StereoModel, state: State, doubts: Doubts, extra_px2: float, most: int
) -> _Climbed:
    for _ in range(most):
        before = state
        state, fit = iterate(images, rim, stereo, state, doubts, extra_px2, hold_blur=extra_px2 > 0.0)
        if _settled(before, state):
            break
    return _Climbed(state, fit)


def _worth_following(climbed: list[_Climbed], doubts: Doubts, worse: float) -> list[_Climbed]:
    """The likeliest first, without those that are elsewhere by nothing or less likely by far."""
    if not climbed:
        return []
    cost = [unlikely(one.fit, climbed[0].fit.even, doubts) for one in climbed]
    kept: list[_Climbed] = []
    for index in np.argsort(cost):
        one = climbed[index]
        if cost[index] > worse * min(cost):
            break
        if not any(_same(one.state, other.state) for other in kept):
            kept.append(one)
    return kept


def glossed(state: State, fit: Fit) -> State:
    """With the beliefs that its shine asks for, ready for any number of profiles."""
    gloss = min(float(np.linalg.norm([gloss_of(fit), roughness_of(fit), GLINT_GLOSS * glint_of(fit)])), GLOSS_MOST)
    effects = {kind: np.maximum(variance, believed(kind, gloss) ** 2) for kind, variance in state.effects.items()}
    return replace(state, effects=effects, gloss=gloss, profile_weight=None)


def finish(images: Images, fine: Rim, stereo: StereoModel, state: State, doubts: Doubts) -> Fit:
    """All profiles, until it settles."""
    for number in range(FINE_STEPS):
        before = state
        state, fit = iterate(images, fine, stereo, state, doubts)
        if number == GLOSS_AT:
            state = replace(glossed(state, fit), profile_weight=state.profile_weight)
        elif number > GLOSS_AT and _settled(before, state):
            break
    return fit


def _alike(images: Images, rim: Rim, stereo: StereoModel, climbed: _Climbed, doubts: Doubts) -> list[_Climbed]:
    """Where the fit may have to be instead: a rim moved by its chamfer's width looks much the same where the chamfers
    ahead are bright and those behind are dark."""
    state, fit = climbed.state, climbed.fit
    width = float(np.median(np.linalg.norm((rim.outer_m - rim.inner_m)[..., :2], axis=-1)))
    if width < 1e-5:
        return []
    found = quality_of(fit, rim, doubts, STRANGE_LEAST)
    strange = found.offset_conflict > STRANGE_OFFSET or found.sizes_conflict > STRANGE_SIZES
    middle = rim.outward.mean(axis=1)
    bright = np.median(
        (fit.steps.chamfer - fit.steps.bore) / _away_from_zero(fit.steps.face - fit.steps.bore), axis=2
    ).mean(axis=0)
    others = []
    for axis in (middle[0, :2], np.array([-middle[0, 1], middle[0, 0]])):
        for sign in (1.0, -1.0):
            way = sign * axis
            facing = middle[:, :2] @ way
            # the rim moved this way: walls ahead gain the chamfer, those behind lose it
            ahead, behind = facing > 0.7, facing < -0.7
            if not ahead.any() or not behind.any():
                continue
            if np.median(bright[ahead]) - np.median(bright[behind]) < BRIGHTER_LEAST and not strange:
                continue
            moved = perturbed(state.pose_camera_hole, np.array([*(-width * way), 0.0, 0.0, 0.0, 0.0]))
            # a wrong place is blurred by more than the lens
            other = start_state(rim, moved, float(np.min(state.blur_px2[:, [0, 2]])))
            with suppress(np.linalg.LinAlgError):
                for number in range(OTHER_STEPS):
                    other, other_fit = iterate(images, rim, stereo, other, doubts, hold_blur=number < OTHER_HELD)
                others.append(_Climbed(other, other_fit))
    return others


def _away_from_zero(values: Array) -> NDArray[np.float64]:
    return np.asarray(np.where(np.abs(values) < 1.0, 1.0, values))
