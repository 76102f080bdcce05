"""From a pair of pictures to the hole's pose, or to the reason why not."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages.images import Pixels
from services.vision.annotate import annotated
from services.vision.coarse_fit import coarse_fit
from services.vision.light import FULL, Light, linear_light, shown
from services.vision.profile_fit import Images, ProfileFit, drawing_offset_m, profile_fit, right_image_offset_px
from services.vision.refusals import (
    Doubtful,
    NotAStereoPair,
    NotEnoughRim,
    NotTheDrawing,
    OutsidePrior,
    PoorFit,
    TooBright,
    TooDark,
    VisionRefusal,
    WrongImage,
)
from services.vision.region import ExpectedRegion, Region, find_hole, solidity_and_aspect
from services.vision.rim_model import Rimmed, RimModel
from services.vision.stereo import StereoModel

# bounds of the refusals; the figures they are compared with stand in the diagnostics of every pose
DV_MOST_PX = 0.12
DU_MOST_PX = 0.3
DRAWING_MOST_M = 0.12e-3
SUPPORT_LEAST = 0.75
EDGES_LEAST = 0.75
SATURATED_GREY = 250.0
SATURATED_MOST = 0.05
# of the four consistency checks, each over its own bound, the sum of squares
DOUBT_MOST = 1.3
# a fit better than this many times the noise is no wrong valley
SURE_COST = 1.0
STEP_LEAST_GREY = 12.0
COST_MOST = 2.0
ROW_MOST_PX = 12.0
PRIOR_SLACK = 1.3
CHAMFER_SHARES = (0.5, 0.0, 1.0)
# systematic errors, one sd, px: of each edge in each picture, and of all edges that face one way; of each edge's ends
SYSTEMATIC_SD_PX = 0.045
TURN_SHARE = 0.7
# and more where the step at the rim is small beside the noise: a dim picture
SYSTEMATIC_SD_NOISE_PX = 0.5


Picture = Light | Pixels


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """`pose_base_hole`, its covariance (6, 6) in x, y, z, rx, ry, rz of the hole frame, the figures behind it, and both
    pictures with what was seen in them."""

    pose_base_hole: Pose
    covariance: Array
    diagnostics: dict[str, float]
    annotated_left: NDArray[np.uint8]
    annotated_right: NDArray[np.uint8]


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


def noise_of(grey: Light) -> float:
    """The pixel noise, grey levels, from the median absolute second difference (Immerkaer 1996 uses the mean)."""
    mask = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
    laplace = cv2.filter2D(grey, -1, mask)[2:-2, 2:-2]
    return max(float(np.median(np.abs(laplace))) * 1.4826 / 6.0, 0.5)


def find_both(left: Light, right: Light, stereo: StereoModel, hole: Rimmed, nominal: Pose) -> tuple[Region, Region]:
    """The hole in both pictures; NotAStereoPair when the rows or the disparity cannot be one hole's."""
    pose_camera_hole = stereo.pose_base_camera.inverse() @ nominal
    centre = pose_camera_hole.translation_m
    # the grey falls on the chamfer
    x, y = (0.5 * (hole.inner_rim_m() + hole.outer_rim_m())[:, :2]).T
    area = 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / centre[2] ** 2
    solidity, aspect = solidity_and_aspect(hole.inner_rim_m()[:, :2])
    expected = [
        ExpectedRegion(area * camera.fx_px * camera.fy_px, (float(u), float(v)), solidity, aspect)
        for camera, (u, v) in zip(stereo.cameras, stereo.project(centre), strict=True)
    ]
    eight_bit = [np.clip(np.rint(light), 0.0, FULL).astype(np.uint8) for light in (left, right)]
    regions = find_hole(eight_bit[0], expected[0], "left"), find_hole(eight_bit[1], expected[1], "right")
    centres = regions[0].centre_px, regions[1].centre_px
    depth = float(stereo.triangulate(*centres)[2])
    if not 0.0 < depth < np.inf:
        raise NotAStereoPair(
            f"the hole's two pictures meet at {depth:.2f} m, want before the cameras: are left and right swapped?"
        )
    apart = float(np.linalg.norm(stereo.apart_px(*centres)))
    if apart > ROW_MOST_PX:
        raise NotAStereoPair(
            f"the hole's two pictures miss each other by {apart:.1f} px, want less than {ROW_MOST_PX:g}: was a camera "
            "moved?"
        )
    return regions


def locate_rim(
    left: Picture,
    right: Picture,
    stereo: StereoModel,
    hole: Rimmed,
    nominal: Pose,
    half_ranges: Array,
) -> Located:
    """The 6-DoF fit of the rim. `nominal` is the hole in the base by the cell's drawing, `half_ranges` (6,) how far it
    may be off, m and rad. Raises a VisionRefusal."""
    images = as_light(left, stereo, "left"), as_light(right, stereo, "right")
    regions = find_both(images[0], images[1], stereo, hole, nominal)
    step = min(regions[0].face_grey - regions[0].threshold, regions[1].face_grey - regions[1].threshold)
    if step < 0.5 * STEP_LEAST_GREY:
        raise TooDark(f"face against hole {2 * step:.0f} grey levels, want {STEP_LEAST_GREY:g} or more")
    noise = max(noise_of(images[0]), noise_of(images[1]))
    model = RimModel.of(hole)
    centre = stereo.triangulate(regions[0].centre_px, regions[1].centre_px)
    rotation = (stereo.pose_base_camera.inverse() @ nominal).rotation
    # where on the chamfer the grey falls most depends on the light; a wrong guess can end in a wrong valley
    refusal: VisionRefusal | None = None
    best: tuple[ProfileFit, dict[str, float]] | None = None
    for share in CHAMFER_SHARES:
        start = coarse_fit(images, model, stereo, Pose(rotation, centre), noise, share)
        fit = profile_fit(images, model, stereo, start, noise)
        try:
            checked = _checked(images, model, stereo, fit, noise)
        except VisionRefusal as error:
            refusal = refusal or error
            continue
        if best is None or fit.cost < best[0].cost:
            best = fit, checked
        if fit.cost < SURE_COST:
            break
    if best is None:
        assert refusal is not None
        raise refusal
    fit, diagnostics = best
    pose_base_hole = stereo.pose_base_camera @ fit.pose_camera_hole
    _inside_prior(nominal, half_ranges, pose_base_hole)
    pictures = [
        annotated(
            shown(images[side], stereo.cameras[side].gamma), regions[side], side, model, stereo, fit.pose_camera_hole
        )
        for side in range(2)
    ]
    covariance = covariance_of(fit, model.facing(), half_ranges, noise)
    return Located(pose_base_hole, covariance, diagnostics, pictures[0], pictures[1])


def _checked(images: Images, model: RimModel, stereo: StereoModel, fit: ProfileFit, noise: float) -> dict[str, float]:
    support = float(np.mean(fit.support))
    edges, all_edges = int(np.sum(np.mean(fit.support, axis=2) > 0.5)), 2 * fit.support.shape[1]
    saturated = float(np.mean(fit.face_grey > SATURATED_GREY))
    if saturated > SATURATED_MOST:
        raise TooBright(
            f"{saturated:.0%} of the face beside the rim is above grey {SATURATED_GREY:g}, want less than "
            f"{SATURATED_MOST:.0%}: expose less, or is there glare on it?"
        )
    step = float(np.median(fit.step_grey))
    if step < STEP_LEAST_GREY:
        raise TooDark(f"face against bore {step:.0f} grey levels at the rim, want {STEP_LEAST_GREY:g} or more")
    if support < SUPPORT_LEAST or edges < EDGES_LEAST * all_edges:
        raise NotEnoughRim(
            f"{support:.0%} of the profiles and {edges} of {all_edges} edges look like the rim, want "
            f"{SUPPORT_LEAST:.0%} and {EDGES_LEAST * all_edges:.0f}: is something in front of it, or glare on it?"
        )
    if fit.cost > COST_MOST:
        raise PoorFit(f"residual {fit.cost:.1f} times the noise, want less than {COST_MOST:g}")
    du, dv = right_image_offset_px(images, model, stereo, fit, noise)
    if abs(dv) > DV_MOST_PX or abs(du) > DU_MOST_PX:
        raise NotAStereoPair(
            f"the right picture is off by ({du:.2f}, {dv:.2f}) px, want less than ({DU_MOST_PX:g}, {DV_MOST_PX:g})"
        )
    width, length = drawing_offset_m(images, model, stereo, fit, noise)
    if max(abs(width), abs(length)) > DRAWING_MOST_M:
        raise NotTheDrawing(
            f"the hole is larger than the drawing by {width * 1e3:.2f} mm at its near edges (half-width) and "
            f"{length * 1e3:.2f} mm at its far ones (half-length), want less than {DRAWING_MOST_M * 1e3:g}"
        )
    checks = np.array([du / DU_MOST_PX, dv / DV_MOST_PX, width / DRAWING_MOST_M, length / DRAWING_MOST_M])
    if checks @ checks > DOUBT_MOST:
        raise Doubtful(
            f"right picture off by ({du:.2f}, {dv:.2f}) px and the hole by ({width * 1e3:.2f}, {length * 1e3:.2f}) mm: "
            f"together {checks @ checks:.1f}, want less than {DOUBT_MOST:g}"
        )
    return {
        "support": support,
        "edges": float(edges),
        "step_grey": step,
        "noise_grey": noise,
        "cost": fit.cost,
        "du_px": du,
        "dv_px": dv,
        "width_off_mm": width * 1e3,
        "length_off_mm": length * 1e3,
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


def covariance_of(fit: ProfileFit, facing: Array, half_ranges: Array, noise_grey: float) -> Array:
    """Noise, and the systematic errors that dominate it: each edge by itself, and all edges that face one way.

    facing (n,): which edges face the same way; half_ranges (6,): what is known without any picture, m and rad.
    """
    inverse = np.linalg.inv(fit.information + np.diag(3.0 / half_ranges**2))
    noise_px = SYSTEMATIC_SD_NOISE_PX * noise_grey / max(float(np.median(fit.step_grey)), STEP_LEAST_GREY)
    edges = np.einsum("kei,kej->ij", fit.edge_lever, fit.edge_lever)
    edges += TURN_SHARE**2 * np.einsum("kei,kej->ij", fit.edge_turn, fit.edge_turn)
    walls = np.zeros((6, 6))
    for way in np.unique(facing):
        lever = fit.edge_lever[:, facing == way].sum(axis=(0, 1))
        walls += np.outer(lever, lever)
    systematic = (SYSTEMATIC_SD_PX**2 + noise_px**2) * (edges + walls)
    return np.asarray(inverse + inverse @ systematic @ inverse)
