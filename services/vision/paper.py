"""The paper's own pipeline as printed (its Eqs. 1-9): grey, threshold, binarise, cross region, centre in both pictures,
parallel stereo, T1. Position only: the orientation is the one printed in Eq. 6."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.annotate import annotated
from services.vision.fit.rim import Rimmed
from services.vision.fit.solve import Doubts
from services.vision.light import FULL, Light, shown
from services.vision.locate import Located, Picture, as_light
from services.vision.refusals import NotAStereoPair
from services.vision.region import ExpectedRegion, Region, find_hole, solidity_and_aspect
from services.vision.stereo import StereoModel

# Eq. 6, signs restored: the hole in the left camera
ROTATION_CAMERA_HOLE = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

MAX_ROW_PX = 12.0


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
    if apart > MAX_ROW_PX:
        raise NotAStereoPair(
            f"the hole's two pictures miss each other by {apart:.1f} px, want less than {MAX_ROW_PX:g}: was a camera "
            "moved?"
        )
    return regions


def hole_from_centres(left_px: Array, right_px: Array, stereo: StereoModel) -> Pose:
    """T1 (Eqs. 4-7) from the cross's centre (2,) in both pictures, px: `pose_base_hole`, printed orientation."""
    return stereo.pose_base_camera @ Pose(ROTATION_CAMERA_HOLE, stereo.triangulate(left_px, right_px))


def locate_paper(
    left: Picture,
    right: Picture,
    stereo: StereoModel,
    hole: Rimmed,
    nominal: Pose,
    half_ranges: Array,
    _doubts: Doubts | None = None,
) -> Located:
    """The centre of the dark cross by disparity. The method does not measure the orientation. The covariance is that of
    the whole range of the hole, for position too: larger than any doubt about drawing or calibration. Raises a
    VisionRefusal."""
    images = as_light(left, stereo, "left"), as_light(right, stereo, "right")
    regions = find_both(images[0], images[1], stereo, hole, nominal)
    # the paper takes the centre of the region's bounding box
    boxes = [region.box_px for region in regions]
    centres = [np.array([box[0] + 0.5 * (box[2] - 1), box[1] + 0.5 * (box[3] - 1)]) for box in boxes]
    pose = hole_from_centres(centres[0], centres[1], stereo)
    diagnostics = {
        "disparity_px": float(centres[0][0] - centres[1][0]),
        "row_difference_px": float(centres[0][1] - centres[1][1]),
    }
    return Located(
        pose,
        np.diag(half_ranges**2 / 3.0),
        diagnostics,
        annotated(shown(images[0], stereo.left.gamma), regions[0], 0),
        annotated(shown(images[1], stereo.right.gamma), regions[1], 1),
    )
