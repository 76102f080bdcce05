"""From a pair of pictures to the hole's pose, or to a refusal with its reason: find, fit, judge."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages.images import Pixels
from services.vision.annotate import annotated_rim
from services.vision.checks import require_drawn_edges, require_inside_prior, require_sound
from services.vision.covariance import covariance_of
from services.vision.detect import Candidate, candidates
from services.vision.elsewhere import edges_elsewhere
from services.vision.evidence.verdict import Evidence, evidence_of, judge
from services.vision.fit.climb import Rival, rims
from services.vision.fit.lens import LensDoubt, lens_doubt
from services.vision.fit.quality import Quality, quality_of
from services.vision.fit.rim import Rim, Rimmed
from services.vision.fit.solve import Doubts, Fit, Images
from services.vision.fit.uncovered import Uncovered, fit_uncovered
from services.vision.fit.valley import with_valleys
from services.vision.light import Light, linear_light, shown
from services.vision.refusals import (
    Doubtful,
    FlatPrint,
    NoCross,
    NotAStereoPair,
    NotSeenInside,
    PoorFit,
    ShallowPocket,
    TwoCrosses,
    VisionRefusal,
    WrongImage,
)
from services.vision.stereo import StereoModel
from services.vision.straightness import lenses_of

# candidates tried; candidates at one place tried first; least score; and least score as a share of the best one's
TRIED, STARTS, MIN_SCORE, COMPETES = 4, 2, 0.6, 0.9
# a rival's weight falls by e for each such share by which it is worse than the best; a rival with more than this weight
# must lie within this distance, m: a chamfer's width or two
RIVAL_WORSE, RIVAL_COUNTS, MAX_RIVAL_DISTANCE_M = 0.12, 0.3, 2.5e-3
# another hole in the pictures: its least support against the best, and its least distance, px
OTHER_SCORE, APART_PX = 0.85, 8.0
CERTAIN_ENOUGH = Doubts()  # typical values of a machined part and a calibration


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """`pose_base_hole`, its covariance (6, 6) in x, y, z, rx, ry, rz of the hole frame (m and rad), the figures behind
    it, both pictures with annotations, and warnings for the user."""

    pose_base_hole: Pose
    covariance: Array
    diagnostics: dict[str, float]
    annotated_left: NDArray[np.uint8]
    annotated_right: NDArray[np.uint8]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """The inputs for one pair."""

    images: Images
    stereo: StereoModel
    hole: Rimmed
    coarse: Rim
    fine: Rim
    doubts: Doubts


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """The best fit about one place; the distance of the farthest other pose there that explains the pictures nearly as
    well, m; and the spread of these about the best (6, 6), m and rad."""

    uncovered: Uncovered
    apart_m: float
    spread: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Attempt:
    """The result of one candidate: the fit, and the part of the rim that it used."""

    fit: Fit
    rim: Rim
    spread: Array
    quality: Quality
    evidence: Evidence


Picture: TypeAlias = "Light | Pixels"


def as_light(image: Picture, stereo: StereoModel, side: str) -> Light:
    """Linear light (height, width), 0 to 255, of the camera's size. A float32 picture is linear already; for another
    (mono or RGB, 8 or 16 bit) the camera's gamma is undone. Raises WrongImage."""
    camera = stereo.left if side == "left" else stereo.right
    if image.shape[:2] != (camera.height_px, camera.width_px):
        raise WrongImage(f"{side}: got {image.shape}, the calibration says ({camera.height_px}, {camera.width_px})")
    if image.dtype == np.float32 and image.ndim == 2:
        return np.asarray(image, dtype=np.float32)
    if image.dtype in (np.uint8, np.uint16) and image.shape[2:] in ((), (3,)):
        return linear_light(np.asarray(image, dtype=image.dtype), "", camera.gamma)
    raise WrongImage(f"{side}: got {image.shape} {image.dtype}, want float32, or uint8 or uint16 with 1 or 3 channels")


def locate_rim(
    left: Picture,
    right: Picture,
    stereo: StereoModel,
    hole: Rimmed,
    nominal: Pose,
    half_ranges: Array,
    doubts: Doubts = CERTAIN_ENOUGH,
) -> Located:
    """The 6-DoF fit of the rim. `nominal` is `pose_base_hole` by the cell's drawing, `half_ranges` (6,) its
    uncertainty, m and rad; `doubts`: the uncertainty of drawing and calibration. Raises a VisionRefusal."""
    images = as_light(left, stereo, "left"), as_light(right, stereo, "right")
    if not np.any(stereo.pose_left_right.translation_m):
        raise NotAStereoPair(
            "calibration.pose_left_right: both cameras stand in one place, want the right one where it stands, m"
        )
    lenses = lenses_of(images, stereo.cameras)
    if lenses.sure:
        stereo = stereo.more_bent(lenses.by_side()[0])
    coarse, fine = rims(hole)
    task = _Task(images, stereo, hole, coarse, fine, doubts)
    found = candidates(images, stereo, hole, nominal, half_ranges)
    if not found:
        raise NoCross(
            "nothing near where the hole should be has its outline in both pictures: is the part there, is it lit?"
        )
    refusal: VisionRefusal | None = None
    attempt = None
    for starts in _places(task, found):
        try:
            attempt = _attempt(task, starts)
            break
        except VisionRefusal as error:
            refusal = refusal or error
    if attempt is None:
        _unless_swapped(task, nominal, half_ranges)
        assert refusal is not None
        raise refusal
    _unless_another(task, found, attempt)
    lens = lens_doubt(attempt.fit, attempt.rim, stereo, doubts, lenses)
    pose_base_hole = stereo.pose_base_camera @ attempt.fit.state.pose_camera_hole
    require_inside_prior(nominal, half_ranges, pose_base_hole)
    pictures = [
        annotated_rim(
            shown(images[side], stereo.cameras[side].gamma), side, fine, stereo, attempt.fit.state.pose_camera_hole
        )
        for side in range(2)
    ]
    covariance = covariance_of(attempt.fit, attempt.rim, attempt.quality, half_ranges, attempt.spread + lens.of_pose())
    return Located(
        pose_base_hole,
        with_valleys(covariance, images, attempt.rim, stereo, attempt.fit, doubts),
        _figures(attempt) | lenses.figures() | _lens_figures(lens),
        pictures[0],
        pictures[1],
        lenses.warnings(),
    )


def _places(task: _Task, found: list[Candidate]) -> Iterator[list[Pose]]:
    """The candidates grouped by place, the likeliest first; those about the same place are starts of one fit."""
    rest = [one for one in found if one.score >= MIN_SCORE * found[0].score][:TRIED]
    while rest:
        centre = task.stereo.project(rest[0].pose_camera_hole.translation_m)
        near = [
            one
            for one in rest
            if np.linalg.norm(task.stereo.project(one.pose_camera_hole.translation_m) - centre, axis=-1).min()
            < APART_PX
        ]
        rest = [one for one in rest if one not in near]
        yield [one.pose_camera_hole for one in near if one.score >= COMPETES * near[0].score]


def _attempt(task: _Task, starts: list[Pose]) -> _Attempt:
    """The fit at one place: from a few starts, and from all of them if that fit is not sound. Raises a
    VisionRefusal."""
    try:
        return _judged(task, _fitted(task, starts[:STARTS]))
    except (FlatPrint, ShallowPocket, NotSeenInside):
        # the rim is found: other starts show no more of the inside
        raise
    except VisionRefusal:
        if len(starts) <= STARTS:
            raise
    return _judged(task, _fitted(task, starts))


def _fitted(task: _Task, starts: list[Pose]) -> _Found:
    """The best fit, sound or not; others that explain as much widen its covariance. Raises PoorFit where there is
    none."""
    found = fit_uncovered(task.images, task.coarse, task.fine, task.stereo, starts, task.doubts)
    if found is None:
        raise PoorFit("no pose explains what is seen at the rim: light it more evenly, uncover it")
    return _Found(found, *_beside(found.fit.state.pose_camera_hole, found.rivals))


def _beside(pose: Pose, rivals: list[Rival]) -> tuple[float, Array]:
    """Distance of the farthest rival that counts, m; and the spread of all about the pose (6, 6), m and rad."""
    apart_m, spread, counted = 0.0, np.zeros((6, 6)), 1.0
    for rival in rivals:
        counts = float(np.exp(-max(rival.worse - 1.0, 0.0) / RIVAL_WORSE))
        moved = pose.inverse() @ rival.pose_camera_hole
        off = np.concatenate([moved.translation_m, moved.rotvec_rad()])
        spread += counts * np.outer(off, off)
        counted += counts
        if counts > RIVAL_COUNTS:
            apart_m = max(apart_m, float(np.linalg.norm(off[:2])))
    return apart_m, spread / counted


def _judged(task: _Task, found: _Found) -> _Attempt:
    fit, rim = found.uncovered.fit, found.uncovered.rim
    # visibility is judged on the whole rim, everything else on the part that was fitted
    quality = replace(quality_of(fit, rim, task.doubts), support=found.uncovered.support)
    require_sound(quality, task.fine)
    require_drawn_edges(edges_elsewhere(task.images, task.stereo, task.fine, fit, quality))
    if found.apart_m > MAX_RIVAL_DISTANCE_M:
        raise Doubtful(
            "two poses explain what is seen at the rim about equally well: the chamfer is bright here and dark there; "
            "use a larger, softer light, or one from another side"
        )
    evidence = evidence_of(task.images, task.stereo, task.hole, rim, fit, quality, task.doubts)
    judge(evidence, quality)
    return _Attempt(fit, rim, found.spread, quality, evidence)


def _unless_swapped(task: _Task, nominal: Pose, half_ranges: Array) -> None:
    """NotAStereoPair when the pictures show the hole if left is taken for right."""
    left, right = task.images
    if left.shape != right.shape:
        return
    swapped = _Task((right, left), task.stereo, task.hole, task.coarse, task.fine, task.doubts)
    found = candidates(swapped.images, task.stereo, task.hole, nominal, half_ranges)
    for starts in _places(swapped, found[:1]):
        try:
            offset = _attempt(swapped, starts).quality.offset_px
        except VisionRefusal:
            return
        raise NotAStereoPair(
            f"the hole is found within {np.linalg.norm(offset):.2f} px with left and right exchanged: give the left "
            "camera's picture as the left one"
        )


def _unless_another(task: _Task, found: list[Candidate], attempt: _Attempt) -> None:
    """TwoCrosses when another candidate, elsewhere in the pictures, is a hole as well."""
    centre = task.stereo.project(attempt.fit.state.pose_camera_hole.translation_m)
    for other in found:
        apart = np.linalg.norm(task.stereo.project(other.pose_camera_hole.translation_m) - centre, axis=-1)
        if apart.min() < APART_PX or other.score < OTHER_SCORE * found[0].score:
            continue
        holes = 0
        with suppress(VisionRefusal):
            for starts in _places(task, [other]):
                _attempt(task, starts)
                holes += 1
        if holes == 0:
            continue
        raise TwoCrosses(f"two such holes are seen, {apart.min():.0f} px apart, want one: cover the other one")


def _figures(attempt: _Attempt) -> dict[str, float]:
    fit, quality, evidence = attempt.fit, attempt.quality, attempt.evidence
    blur = np.sqrt(fit.state.blur_px2[:, [0, 2]])
    outer, inner, near, far = quality.sizes_m * 1e3
    return {
        "support": quality.supported,
        "step_grey": quality.step_grey,
        "noise_grey": quality.noise_grey,
        "residual": quality.residual,
        "rough": quality.rough,
        "shine": fit.state.gloss,
        "blur_left_u_px": float(blur[0, 0]),
        "blur_left_v_px": float(blur[0, 1]),
        "blur_right_u_px": float(blur[1, 0]),
        "blur_right_v_px": float(blur[1, 1]),
        "du_px": float(quality.offset_px[0]),
        "dv_px": float(quality.offset_px[1]),
        "offset_conflict": quality.offset_conflict,
        "outer_off_mm": float(outer),
        "inner_off_mm": float(inner),
        "near_off_mm": float(near),
        "far_off_mm": float(far),
        "sizes_conflict": quality.sizes_conflict,
        "seen_inside": evidence.seen,
        "chamfer": evidence.chamfer,
        "black": evidence.black,
        "deeper": evidence.deeper,
    }


def _lens_figures(lens: LensDoubt) -> dict[str, float]:
    """The depth error by the lenses' doubt alone, one sd, mm; and the k1 estimated from rim and edges."""
    return {
        "lens_depth_sd_mm": float(np.sqrt(lens.of_pose()[2, 2])) * 1e3,
        "k1_left": float(lens.k1[0]),
        "k1_right": float(lens.k1[1]),
    }
