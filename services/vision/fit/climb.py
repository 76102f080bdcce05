"""Climbs from a start to the best pose: wide valleys first, few profiles first; then tries the places that look alike
because bright and dark chamfers can be confused."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.fit.blur import roundness_cost
from services.vision.fit.medians import median, median_of_last
from services.vision.fit.quality import roughness_of
from services.vision.fit.rim import Rim, Rimmed, perturbed, seen
from services.vision.fit.solve import (
    MAX_GLOSS,
    Doubts,
    Fit,
    Images,
    Look,
    State,
    believed,
    iterate,
    look,
    start_state,
    stepped,
)
from services.vision.fit.steps import STEP_PX
from services.vision.stereo import StereoModel

FEW_PROFILES = 72
# blur added to the pictures, px^2; most steps with it, with few profiles; and how many times less likely than the best,
# by the logarithm, a start may be to be followed further
STAGES = ((1.0, 3, 1.6), (0.0, 3, 1.35))
FINE_STEPS = 5
# a chamfer up to this much brighter than the face, times, is no glint; the limit of a glint; its weight
GLINT_FREE, MAX_GLINT, GLINT_GLOSS = 1.15, 1.5, 0.1
GLOSS_AT = 1  # the fine step after which shine and texture are measured
SETTLED_M, SETTLED_RAD = 6e-6, 6e-5
# steps from a rim shifted by its chamfer's width, the first of them with the blur held; how many times less likely than
# the best a place may be after one step to be followed; number of rounds, each from a place better than all before
OTHER_STEPS, OTHER_HELD, AT_SECOND_SIGHT, ROUNDS = 5, 3, 1.75, 2
# a place worse by less than this may be better with all profiles; number of places tried with all profiles
ALIKE_SHARE, FINISHED = 1.2, 3
# a place worse by more than this is no rival
RIVAL_SHARE = 1.5
# the pose that the fit reached before it tried other places never counts as worse than this: the model that rejects it
# may be wrong
CAME_TO_WORSE = 1.28
SAME_M = 0.05e-3
# a ridge of light at the bore's edge: brighter, times, than the face and the area farther in, beyond so many noises, on
# a face at least this bright; the cost of one, minus the log likelihood
RIDGE_FREE, RIDGE_NOISES, RIDGE_FACE, RIDGE_COST = 1.15, 3.0, 20.0, 12.0
MARGIN_PX = 40


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
    # of a small turn its angle is that of the matrix's distance to one, by the root of 2
    turned_rad = float(np.linalg.norm(moved.rotation - np.eye(3))) / np.sqrt(2.0)
    return bool(np.linalg.norm(moved.translation_m) < SETTLED_M and turned_rad < SETTLED_RAD)


def _same(one: State, other: State) -> bool:
    return one.pose_camera_hole.distance_to_m(other.pose_camera_hole) < SAME_M


def misfit(fit: Fit | Look, even: Array) -> float:
    """Mean of log(1 + r^2 / (4 s^2)) over the samples. Poses can be compared if they use the same `even` s^2 (2, G)."""
    inside = fit.profiles.inside
    square = fit.steps.residual**2 / even[..., None, None]
    return float(np.sum(np.log1p(0.25 * square) * inside) / max(float(inside.sum()), 1.0))


def ridges(fit: Fit | Look) -> float:
    """The amount of light that looks like a chamfer where the bore should begin: brighter than the face and than the
    area farther in; summed over edges that show it in both pictures, 1 for an edge brighter by the face's grey."""
    bore, face = median_of_last(fit.steps.bore), median_of_last(fit.steps.face)
    rest = np.maximum(face, median_of_last(fit.profiles.beyond))
    noise = np.sqrt(median_of_last(fit.variance.reshape(*face.shape, -1)))
    excess = (bore - RIDGE_FREE * rest - RIDGE_NOISES * noise) / np.maximum(face, RIDGE_FACE)
    return float(np.sum(np.clip(excess, 0.0, 1.0)))


def unlikely(fit: Fit | Look, even: Array, doubts: Doubts) -> float:
    """The misfit plus the costs of an odd blur, odd sizes and ridges: minus the log likelihood per sample, up to a
    constant."""
    sizes = 0.5 * float(np.sum((fit.state.sizes_m / doubts.sds()) ** 2)) + RIDGE_COST * ridges(fit)
    # neighbours along a profile and along the rim see the same pixels
    independent = 2.0 * STEP_PX * float(np.mean(np.minimum(fit.seen.spacing_px, 1.0)))
    samples = max(float(fit.profiles.inside.sum()), 1.0)
    return misfit(fit, even) + (roundness_cost(fit.state.blur_px2) + sizes) / (independent * samples)


def gloss_of(fit: Fit) -> float:
    """The difference of the face beside the rim between the cameras, as a share of its grey, without the overall
    level."""
    face = np.maximum(fit.steps.face, 1.0)
    ratio = np.log(face[0] / face[1])
    # noise alone makes them differ too
    noise = np.sqrt(median(fit.variance) / 3.0) / max(median(face), 1.0)
    spread = median(np.abs(ratio - median(ratio))) * 1.4826
    return float(np.sqrt(max(spread**2 - 2.0 * noise**2, 0.0)))


def glint_of(fit: Fit) -> float:
    """Excess brightness of the brightest chamfers over the face, times the face's grey; broken edges shine alike."""
    face = np.maximum(fit.steps.face.mean(axis=2), 1.0)
    brightest = float(np.quantile(fit.steps.chamfer.mean(axis=2) / face, 0.8))
    return float(np.clip(brightest - GLINT_FREE, 0.0, MAX_GLINT))


@dataclass(frozen=True, slots=True, eq=False)
class _Climbed:
    """The result with few profiles: the state after the last step, and the look before it."""

    state: State
    fit: Fit


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """Another place that explains the pictures: how many times less likely than the best, by the logarithm."""

    pose_camera_hole: Pose
    worse: float


def climb(
    images: Images, coarse: Rim, fine: Rim, stereo: StereoModel, starts: Sequence[Pose], doubts: Doubts
) -> tuple[Fit | None, list[Rival]]:
    """The best fit from starts about one place, each within a pixel or two of the rim in both pictures, and its rivals.

    Starts that lead to the same place are followed once. A start that leaves far more unexplained than the best is
    given up: it is neither the best fit nor a rival of it.
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
    seen_about: list[_Climbed] = []
    for _ in range(ROUNDS):
        if not climbed or any(climbed[0] is one for one in seen_about):
            break
        seen_about.append(climbed[0])
        climbed = _worth_following(climbed + _alike(images, coarse, stereo, climbed[0], doubts), doubts, RIVAL_SHARE)
    fits = []
    for one in climbed[:FINISHED]:
        if _cost(one, climbed, doubts) > ALIKE_SHARE * _cost(climbed[0], climbed, doubts):
            break
        with suppress(np.linalg.LinAlgError):
            fits.append(finish(images, fine, stereo, glossed(one.state, one.fit), doubts))
    if not fits:
        return None, []
    left_over = [unlikely(fit, fits[0].even, doubts) for fit in fits]
    best = fits[int(np.argmin(left_over))]
    least = min(_cost(one, climbed, doubts) for one in climbed)
    rivals = [
        Rival(fit.state.pose_camera_hole, cost / min(left_over)) for fit, cost in zip(fits, left_over, strict=True)
    ] + [
        Rival(one.fit.state.pose_camera_hole, _cost(one, climbed, doubts) / least)
        for one in climbed
        if not any(_same(one.state, fit.state) for fit in fits)
    ]
    came_to = [one for one in seen_about if not any(one is other for other in climbed)]
    rivals += [Rival(one.state.pose_camera_hole, CAME_TO_WORSE) for one in came_to]
    return best, [one for one in rivals if best.state.pose_camera_hole.distance_to_m(one.pose_camera_hole) > SAME_M]


def _cost(one: _Climbed, climbed: list[_Climbed], doubts: Doubts) -> float:
    return unlikely(one.fit, climbed[0].fit.even, doubts)


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
    """The likeliest first, without those at the same place as another or far less likely."""
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
    """The state with the priors that the shine of the face calls for, ready for any number of profiles."""
    gloss = min(float(np.linalg.norm([gloss_of(fit), roughness_of(fit), GLINT_GLOSS * glint_of(fit)])), MAX_GLOSS)
    effects = {kind: np.maximum(variance, believed(kind, gloss) ** 2) for kind, variance in state.effects.items()}
    return replace(state, effects=effects, gloss=gloss, profile_weight=None)


def finish(images: Images, fine: Rim, stereo: StereoModel, state: State, doubts: Doubts) -> Fit:
    """Iterate with all profiles until the fit settles."""
    for number in range(FINE_STEPS):
        before = state
        state, fit = iterate(images, fine, stereo, state, doubts)
        if number == GLOSS_AT:
            state = replace(glossed(state, fit), profile_weight=state.profile_weight)
        elif number > GLOSS_AT and _settled(before, state):
            break
    return fit


def _alike(images: Images, rim: Rim, stereo: StereoModel, climbed: _Climbed, doubts: Doubts) -> list[_Climbed]:
    """Other places where the fit may belong: a rim shifted by its chamfer's width looks much the same if the chamfers
    ahead are as bright as the face and those behind as dark as the bore, and if the pictures are blurred."""
    width = float(np.median(np.linalg.norm((rim.outer_m - rim.inner_m)[..., :2], axis=-1)))
    if width < 1e-5:
        return []
    least = unlikely(climbed.fit, climbed.fit.even, doubts)
    along = rim.outward[0].mean(axis=0)[:2]
    others = []
    for axis in (along, np.array([-along[1], along[0]])):
        for way in (axis, -axis):
            moved = perturbed(climbed.state.pose_camera_hole, np.array([*(width * way), 0.0, 0.0, 0.0, 0.0]))
            # at a wrong place the blur is larger than the lens's
            state = start_state(rim, moved, float(np.min(climbed.state.blur_px2[:, [0, 2]])))
            passed: list[tuple[float, _Climbed]] = []
            with suppress(np.linalg.LinAlgError):
                for number in range(OTHER_STEPS):
                    before, looked = state, look(images, rim, stereo, state)
                    cost = unlikely(looked, climbed.fit.even, doubts)
                    if number == 1 and cost > AT_SECOND_SIGHT * least:
                        break
                    state, fit = stepped(rim, looked, doubts, hold_blur=number < OTHER_HELD)
                    passed.append((cost, _Climbed(before, fit)))
                else:
                    others.append(_Climbed(state, fit))
                    # where neighbouring places look alike, the steps on the way count as much as the last one
                    others += [one for cost, one in passed[1:-1] if cost < min(least, passed[-1][0])]
    return others
