"""The paper's own pipeline as printed (its Eqs. 1-9): grey, threshold, binarise, cross region, centre in both pictures,
parallel stereo, T1. Position only: the orientation is the one printed in Eq. 6."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.annotate import annotated
from services.vision.light import shown
from services.vision.locate import Located, Picture, as_light, find_both
from services.vision.rim_model import Rimmed
from services.vision.stereo import StereoModel

# Eq. 6, signs restored: the hole in the left camera
ROTATION_CAMERA_HOLE = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


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
) -> Located:
    """The centre of the dark cross by disparity. It claims nothing of the orientation, so its covariance there, and in
    position too, is only that of where the hole can be at all. Raises a VisionRefusal."""
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
