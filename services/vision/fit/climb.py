"""From a start to the best pose: wide valleys first, few profiles first, and the other places where a bright chamfer
and a dark one would look alike."""

from __future__ import annotations

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
# blur added to the pictures, px^2, and most steps with it, with few profiles
STAGES = ((1.0, 3), (0.0, 3))
FINE_STEPS = 5
# a chamfer that much brighter than the face, times, is no glint; more than that is no more of one; what it is worth
GLINT_FREE, GLINT_MOST, GLINT_GLOSS = 1.15, 1.5, 0.1
GLOSS_AT = 1  # the fine step after which shine and texture are measured
SETTLED_M, SETTLED_RAD = 6e-6, 6e-5
OTHER_STEPS, OTHER_HELD = 5, 3
# one chamfer as bright as the face and its opposite as dark as the bore: the same picture as a rim moved by its width
# what is worse by less than that may be the better one with all profiles
ALIKE_SHARE = 1.06
SAME_M = 0.1e-3
MARGIN_PX = 40
# a fit that pulls at the calibration or the drawing by more (chi2 of 2 and of 4) has perhaps gone astray
STRANGE_OFFSET, STRANGE_SIZES, STRANGE_LEAST = 4.0, 12.0, 0.1


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


def climb(images: Images, coarse: Rim, fine: Rim, stereo: StereoModel, start: Pose, doubts: Doubts) -> list[Fit]:
    """The fit from a start within a pixel or two of the rim in both pictures; and a second one, elsewhere, where few
    profiles do not tell which of the two it is."""
    state = start_state(coarse, start)
    fit = None
    for extra, most in STAGES:
        looked = images if extra == 0.0 else _blurred(images, extra, coarse, stereo, state.pose_camera_hole)
        for _ in range(most):
            before = state
            state, fit = iterate(looked, coarse, stereo, state, doubts, extra, hold_blur=extra > 0.0)
            if _settled(before, state):
                break
    assert fit is not None
    found = quality_of(fit, coarse, doubts, STRANGE_LEAST)
    strange = found.offset_conflict > STRANGE_OFFSET or found.sizes_conflict > STRANGE_SIZES
    alike = _best_of_alike(images, coarse, stereo, state, fit, doubts, strange)
    return [finish(images, fine, stereo, glossed(*one), doubts) for one in alike]


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


def _best_of_alike(
    images: Images, rim: Rim, stereo: StereoModel, state: State, fit: Fit, doubts: Doubts, strange: bool
) -> list[tuple[State, Fit]]:
    """The likeliest, and the next one that is nearly as likely, of what was found and of the poses aside by a chamfer's
    width, of which one looks like the other where the chamfer is bright on one side and dark on the other."""
    width = float(np.median(np.linalg.norm((rim.outer_m - rim.inner_m)[..., :2], axis=-1)))
    if width < 1e-5:
        return [(state, fit)]
    found = [(unlikely(fit, fit.even, doubts), state, fit)]
    middle = rim.outward.mean(axis=1)
    dark = np.median(
        (fit.steps.chamfer - fit.steps.bore) / _away_from_zero(fit.steps.face - fit.steps.bore), axis=2
    ).mean(axis=0)
    for axis in (middle[0, :2], np.array([-middle[0, 1], middle[0, 0]])):
        for sign in (1.0, -1.0):
            way = sign * axis
            facing = middle[:, :2] @ way
            # the rim moved this way: walls ahead gain the chamfer, those behind lose it
            ahead, behind = facing > 0.7, facing < -0.7
            if not ahead.any() or not behind.any():
                continue
            alike = np.median(dark[ahead]) > 0.5 > np.median(dark[behind])
            if not alike and not strange:
                continue
            moved = perturbed(state.pose_camera_hole, np.array([*(-width * way), 0.0, 0.0, 0.0, 0.0]))
            # a wrong place is blurred by more than the lens
            other = start_state(rim, moved, float(np.min(state.blur_px2[:, [0, 2]])))
            for number in range(OTHER_STEPS):
                other, other_fit = iterate(images, rim, stereo, other, doubts, hold_blur=number < OTHER_HELD)
            found.append((unlikely(other_fit, fit.even, doubts), other, other_fit))
    found.sort(key=lambda one: one[0])
    best = found[0]
    near = [one for one in found[1:] if one[0] < ALIKE_SHARE * best[0] and not _same(best[1], one[1])]
    return [(one[1], one[2]) for one in (best, *near[:1])]


def _away_from_zero(values: Array) -> NDArray[np.float64]:
    return np.asarray(np.where(np.abs(values) < 1.0, 1.0, values))
