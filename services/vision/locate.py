"""From a pair of pictures to the hole's pose, or to the reason why not: find, fit, judge."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages.images import Pixels
from services.vision.annotate import annotated_rim
from services.vision.detect import Candidate, candidates
from services.vision.evidence.verdict import Evidence, evidence_of, judge
from services.vision.fit.climb import climb, rims, unlikely
from services.vision.fit.lens import LensDoubt, lens_doubt
from services.vision.fit.quality import Quality, quality_of
from services.vision.fit.rim import Rim, Rimmed
from services.vision.fit.solve import Doubts, Fit, Images
from services.vision.hidden import hidden_parts
from services.vision.light import Light, linear_light, shown
from services.vision.refusals import (
    CutOff,
    Doubtful,
    NoCross,
    NotAStereoPair,
    NotEnoughRim,
    NotTheDrawing,
    OutsidePrior,
    PoorFit,
    TooBright,
    TooDark,
    TwoCrosses,
    VisionRefusal,
    WrongImage,
)
from services.vision.stereo import StereoModel
from services.vision.straightness import lenses_of

# of the rim: that must lie inside both pictures, look like a rim, and the share of its edges that must
INSIDE_LEAST, SUPPORT_LEAST, EDGES_LEAST = 0.6, 0.5, 0.5
SATURATED_MOST, RIM_SATURATED_MOST = 0.25, 0.75
STEP_NOISES, STEP_LEAST_GREY = 4.0, 4.0
# a face darker than that could hide a hole
DARK_GREY = 25.0
# on such a face a step of less, times the noise, is what is wrong with it when the rim is not seen well
DIM_NOISES = 8.0
LONE_LEAST, LONE_BESIDE = 0.7, 0.9
RESIDUAL_MOST = 0.1
# how rough what is seen at the rim may be, share of the step
ROUGH_MOST = 0.16
# chi2 of what the pictures say against the calibration (2) and against the drawing (4)
OFFSET_MOST, SIZES_MOST = 7.0, 25.0
# from there on they make the covariance larger
OFFSET_FREE, SIZES_FREE = 2.0, 6.0
# errors have wider tails than a Gaussian: its variances times
TAIL = 1.5
# the less of the rim is seen, the more what covers it may have pulled at the rest: a third hidden, variances times 3.7
HIDDEN = 8.0
# marks along an edge move it as a whole: with a texture of 2 % of the step variances are doubled
TEXTURED = 50.0
PRIOR_SLACK = 1.3
# candidates that are tried, and how good, against the best, one must be
TRIED, SCORE_LEAST, COMPETES = 4, 0.6, 0.9
# another fit about the same place that leaves less than so many times as much unexplained may be the right one: the
# covariance reaches it; and how far away it may be, m: a chamfer's width or two
RIVAL_SHARE, RIVAL_MOST_M = 1.12, 2.5e-3
# another hole in the pictures: as well supported, and that far away, px
OTHER_SCORE, APART_PX = 0.85, 8.0
CERTAIN_ENOUGH = Doubts()  # a machined part and a calibration, as they mostly are


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """`pose_base_hole`, its covariance (6, 6) in x, y, z, rx, ry, rz of the hole frame, the figures behind it, both
    pictures with what was seen in them, and what a user should be told though there is a pose."""

    pose_base_hole: Pose
    covariance: Array
    diagnostics: dict[str, float]
    annotated_left: NDArray[np.uint8]
    annotated_right: NDArray[np.uint8]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """What is asked of one pair."""

    images: Images
    stereo: StereoModel
    hole: Rimmed
    coarse: Rim
    fine: Rim
    doubts: Doubts


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """The best fit about one place; and of all others there that explain the pictures nearly as well how far they are,
    the farthest, m, and their spread about the best (6, 6), m and rad."""

    fit: Fit
    apart_m: float
    spread: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Attempt:
    """What one candidate came to."""

    fit: Fit
    spread: Array
    quality: Quality
    evidence: Evidence


Picture = Light | Pixels


def as_light(image: Picture, stereo: StereoModel, side: str) -> Light:
    """Linear light (height, width), 0 to 255, of the camera's size: a float32 picture is that already, the numbers of
    another (mono or RGB, 8 or 16 bit) get the camera's gamma undone. WrongImage otherwise."""
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
    """The 6-DoF fit of the rim. `nominal` is the hole in the base by the cell's drawing, `half_ranges` (6,) how far it
    may be off, m and rad; `doubts`: how exactly drawing and calibration are known. Raises a VisionRefusal."""
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
    for one in _fits(task, found):
        try:
            attempt = _judged(task, one)
            break
        except VisionRefusal as error:
            refusal = refusal or error
    if attempt is None:
        _unless_swapped(task, nominal, half_ranges)
        raise refusal or PoorFit("no pose explains what is seen at the rim: light it more evenly, uncover it")
    _unless_another(task, found, attempt)
    lens = lens_doubt(attempt.fit, fine, stereo, doubts, lenses)
    pose_base_hole = stereo.pose_base_camera @ attempt.fit.state.pose_camera_hole
    _inside_prior(nominal, half_ranges, pose_base_hole)
    pictures = [
        annotated_rim(
            shown(images[side], stereo.cameras[side].gamma), side, fine, stereo, attempt.fit.state.pose_camera_hole
        )
        for side in range(2)
    ]
    return Located(
        pose_base_hole,
        covariance_of(attempt.fit, attempt.quality, half_ranges, attempt.spread + lens.of_pose()),
        _figures(attempt) | lenses.figures() | _lens_figures(lens),
        pictures[0],
        pictures[1],
        lenses.warnings(),
    )


def _fits(task: _Task, found: list[Candidate]) -> Iterator[_Found]:
    """What the candidates come to, the likeliest first. Those about the same place compete: the best fit stands for
    all, whether it is then found sound or not; others that explain as much widen its covariance."""
    rest = [one for one in found if one.score >= SCORE_LEAST * found[0].score][:TRIED]
    while rest:
        centre = task.stereo.project(rest[0].pose_camera_hole.translation_m)
        near = [
            one
            for one in rest
            if np.linalg.norm(task.stereo.project(one.pose_camera_hole.translation_m) - centre, axis=-1).min()
            < APART_PX
        ]
        rest = [one for one in rest if one not in near]
        starts = [one.pose_camera_hole for one in near if one.score >= COMPETES * near[0].score]
        fits = climb(task.images, task.coarse, task.fine, task.stereo, starts, task.doubts)
        if fits:
            left_over = [unlikely(fit, fits[0].even, task.doubts) for fit in fits]
            order = np.argsort(left_over)
            best = fits[order[0]]
            apart_m, spread = 0.0, np.zeros((6, 6))
            for index in order[1:]:
                if left_over[index] > RIVAL_SHARE * left_over[order[0]]:
                    break
                moved = best.state.pose_camera_hole.inverse() @ fits[index].state.pose_camera_hole
                off = np.concatenate([moved.translation_m, moved.rotvec_rad()])
                spread += np.outer(off, off)
                apart_m = max(apart_m, float(np.linalg.norm(off[:2])))
            yield _Found(best, apart_m, spread)


def _judged(task: _Task, found: _Found) -> _Attempt:
    fit = found.fit
    quality = quality_of(fit, task.fine, task.doubts)
    _checked(quality, task.fine)
    if found.apart_m > RIVAL_MOST_M:
        raise Doubtful(
            "two poses explain what is seen at the rim about equally well: the chamfer is bright here and dark there; "
            "use a larger, softer light, or one from another side"
        )
    evidence = evidence_of(task.images, task.stereo, task.hole, task.fine, fit, quality, task.doubts)
    judge(evidence, quality)
    return _Attempt(fit, found.spread, quality, evidence)


def _checked(quality: Quality, rim: Rim) -> None:
    if quality.saturated > SATURATED_MOST:
        raise TooBright(
            f"{quality.saturated:.0%} of the face beside the rim is saturated, want less than {SATURATED_MOST:.0%}: "
            "expose less, or take the glare off it"
        )
    if quality.rim_saturated > RIM_SATURATED_MOST:
        raise TooBright(
            f"{quality.rim_saturated:.0%} of the rim is beside something saturated, want less than "
            f"{RIM_SATURATED_MOST:.0%}: expose less, or take the glare off the chamfer"
        )
    if quality.inside < INSIDE_LEAST:
        raise CutOff(
            f"{quality.inside:.0%} of the rim lies inside the picture, want {INSIDE_LEAST:.0%}: move camera or part"
        )
    step = max(STEP_NOISES * quality.noise_grey, STEP_LEAST_GREY)
    dark = quality.face_grey < DARK_GREY
    too_dark = TooDark(
        f"the rim's step is {quality.step_grey:.0f} grey levels in noise of {quality.noise_grey:.1f}, want "
        f"{max(DIM_NOISES * quality.noise_grey, step):.0f} or more: expose longer, or light it more"
    )
    dim = dark and quality.step_grey < DIM_NOISES * quality.noise_grey
    if quality.step_grey < step:
        if not dark:
            raise NoCross(
                f"where the rim should be the step is {quality.step_grey:.0f} grey levels in noise of "
                f"{quality.noise_grey:.1f}, on a face of grey {quality.face_grey:.0f}: no such hole is there; is it "
                "the right part, and the right way round?"
            )
        raise too_dark
    # in each picture by itself: one that shows it all does not speak for one that shows something else
    seen = quality.support.mean(axis=1)
    edges = np.mean(quality.support > 0.5, axis=1)
    if seen.min() < SUPPORT_LEAST or edges.min() < EDGES_LEAST:
        if dim:
            raise too_dark
        side = int(np.argmin(np.minimum(seen, edges)))
        raise NotEnoughRim(
            f"{seen[side]:.0%} of the rim and {edges[side]:.0%} of its edges can be seen in the "
            f"{('left', 'right')[side]} picture, want {SUPPORT_LEAST:.0%}; hidden or dark is "
            f"{hidden_parts(quality.support, rim)}: take away what covers it, or light the dark side"
        )
    lone = _lone_edges(quality.support, quality.astray)
    if len(lone):
        raise NotTheDrawing(
            f"{len(lone)} edges of the rim are not where the drawing has them, and nothing covers them, for all beside "
            "them is seen: is it the right part and cell?"
        )
    if quality.residual > RESIDUAL_MOST or quality.rough > ROUGH_MOST:
        if dim:
            raise too_dark
        raise PoorFit(
            f"at the rim {quality.residual:.0%} of the step is left unexplained, want less than "
            f"{RESIDUAL_MOST:.0%}, and its texture is {quality.rough:.0%} of it, want less than {ROUGH_MOST:.0%}: use "
            "a larger, softer light"
        )
    # an outline of another size pulls at the calibration as well, and harder at the drawing
    drawing_first = quality.sizes_conflict > quality.offset_conflict
    if quality.offset_conflict > OFFSET_MOST and not drawing_first:
        du, dv = quality.offset_px
        raise NotAStereoPair(
            f"the right picture is off by ({du:.2f}, {dv:.2f}) px or more ({quality.offset_conflict:.0f}, want "
            f"less than {OFFSET_MOST:g}): was a camera moved, do the pictures belong together, does the light glare "
            "in one?"
        )
    if quality.sizes_conflict > SIZES_MOST or quality.offset_conflict > OFFSET_MOST:
        outer, inner, near, far = quality.sizes_m * 1e3
        raise NotTheDrawing(
            f"the outline is not the drawing's: outer line {outer:+.2f} mm, inner {inner:+.2f}, near edges "
            f"{near:+.2f}, far {far:+.2f} ({quality.sizes_conflict:.0f}, want less than {SIZES_MOST:g}; the pictures "
            f"apart by {quality.offset_conflict:.0f}, want {OFFSET_MOST:g}): is it the right part and cell, is "
            "cell.hole.tolerance too small?"
        )


def _lone_edges(support: Array, astray: Array) -> NDArray[np.int64]:
    """Edges of which neither picture shows any step where the drawing has one, face or hole going on there, though they
    show both neighbours whole: what covers an edge has a border itself, and covers a part of what is beside it.
    `support` and `astray` (2, G): shares, the groups in order around the rim."""
    least = support.min(axis=0)
    beside = np.minimum(np.roll(least, 1), np.roll(least, -1))
    return np.flatnonzero((astray.min(axis=0) > LONE_LEAST) & (beside > LONE_BESIDE))


def _unless_swapped(task: _Task, nominal: Pose, half_ranges: Array) -> None:
    """NotAStereoPair when the pictures show the hole if left is taken for right."""
    left, right = task.images
    if left.shape != right.shape:
        return
    swapped = _Task((right, left), task.stereo, task.hole, task.coarse, task.fine, task.doubts)
    found = candidates(swapped.images, task.stereo, task.hole, nominal, half_ranges)
    for one in _fits(swapped, found[:1]):
        try:
            _judged(swapped, one)
        except VisionRefusal:
            return
        offset = quality_of(one.fit, task.fine, task.doubts).offset_px
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
            for one in _fits(task, [other]):
                _judged(task, one)
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
    """What the lenses' doubt alone is worth, one sd: the depth in mm; and the k1 that rim and edges speak for."""
    return {
        "lens_depth_sd_mm": float(np.sqrt(lens.of_pose()[2, 2])) * 1e3,
        "k1_left": float(lens.k1[0]),
        "k1_right": float(lens.k1[1]),
    }


def _inside_prior(nominal: Pose, half_ranges: Array, pose_base_hole: Pose) -> None:
    off = nominal.inverse() @ pose_base_hole
    error = np.concatenate([off.translation_m, off.rotvec_rad()])
    worst = int(np.argmax(np.abs(error) / half_ranges))
    if abs(error[worst]) > PRIOR_SLACK * half_ranges[worst]:
        name = ("x", "y", "z", "rx", "ry", "rz")[worst]
        unit, factor = ("mm", 1e3) if worst < 3 else ("rad", 1.0)
        raise OutsidePrior(
            f"{name} is {error[worst] * factor:.3g} {unit} from the nominal hole, want within "
            f"{half_ranges[worst] * PRIOR_SLACK * factor:.3g}"
        )


def covariance_of(fit: Fit, quality: Quality, half_ranges: Array, beside: Array) -> Array:
    """The fit's own (noise, blur, calibration, drawing, edges that are off), more where the pictures pull at the
    calibration or at the drawing; and what stands `beside` (6, 6), other poses and the lenses' doubt; with what is
    known without any picture: half_ranges (6,), m and rad."""
    posterior = fit.covariance[:6, :6]
    strain = TAIL * max(quality.offset_conflict / OFFSET_FREE, quality.sizes_conflict / SIZES_FREE, 1.0)
    strain *= (1.0 + HIDDEN * (1.0 - quality.supported)) * (1.0 + TEXTURED * quality.rough)
    known = np.linalg.inv(posterior * strain + beside) + np.diag(3.0 / half_ranges**2)
    covariance = np.linalg.inv(known)
    return np.asarray(0.5 * (covariance + covariance.T))
