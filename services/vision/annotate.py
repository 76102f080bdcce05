"""The pictures as the paper's Figure 6: the cross region in a red rectangle, its centre a red dot; ours adds a rim."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from services.vision.region import Region
from services.vision.rim_model import RimModel
from services.vision.stereo import StereoModel

RED, GREEN, BLUE = (255, 40, 40), (40, 220, 60), (60, 140, 255)
SUBPIXEL_BITS = 4


def annotated(
    grey: NDArray[np.uint8],
    region: Region,
    side: int,
    model: RimModel | None = None,
    stereo: StereoModel | None = None,
    pose_camera_hole: Pose | None = None,
) -> NDArray[np.uint8]:
    """RGB picture of one side (0 left, 1 right) with what was seen; the fitted rim and axes where there is a pose."""
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB)
    left, top, width, height = region.box_px
    cv2.rectangle(picture, (left - 6, top - 6), (left + width + 5, top + height + 5), RED, 1)
    centre = region.centre_px
    if model is not None and stereo is not None and pose_camera_hole is not None:
        for points in (model.outer_m, model.inner_m):
            line = stereo.project(pose_camera_hole.apply(points))[side]
            for edge in line:
                fixed = np.round(edge * 2**SUBPIXEL_BITS).astype(np.int32)
                cv2.polylines(picture, [fixed.reshape(-1, 1, 2)], False, GREEN, 1, cv2.LINE_AA, SUBPIXEL_BITS)
        origin, tip = stereo.project(pose_camera_hole.apply(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.03]])))[side]
        cv2.arrowedLine(picture, _pixel(origin), _pixel(tip), BLUE, 1, cv2.LINE_AA)
        centre = origin
    cv2.circle(picture, _pixel(centre), 2, RED, -1, cv2.LINE_AA)
    u, v = centre
    cv2.putText(
        picture,
        f"{('left', 'right')[side]} ({u:.1f}, {v:.1f})",
        (8, 20),
        cv2.FONT_HERSHEY_SIMPLEX,
        0.5,
        RED,
        1,
        cv2.LINE_AA,
    )
    return np.asarray(picture, dtype=np.uint8)


def _pixel(point: NDArray[np.float64]) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
