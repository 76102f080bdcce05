"""Annotated pictures as in the paper's Figure 6: the cross region in a red rectangle, its centre a red dot, and the
fitted rim."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from services.vision.fit.rim import Rim
from services.vision.region import Region
from services.vision.stereo import StereoModel

RED, GREEN, BLUE = (255, 40, 40), (40, 220, 60), (60, 140, 255)
SUBPIXEL_BITS = 4

Grey = NDArray[np.uint8]


def annotated(grey: Grey, region: Region, side: int) -> Grey:
    """RGB picture of one side (0 left, 1 right) with the dark region that was found."""
    left, top, width, height = region.box_px
    return _framed(
        np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB), dtype=np.uint8),
        side,
        (left, top, left + width - 1, top + height - 1),
        region.centre_px,
    )


def annotated_rim(grey: Grey, side: int, rim: Rim, stereo: StereoModel, pose_camera_hole: Pose) -> Grey:
    """RGB picture of one side (0 left, 1 right) with the fitted rim and the hole's axis, drawn outward from the
    face."""
    picture = np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB), dtype=np.uint8)
    lines = stereo.project(pose_camera_hole.apply(np.stack([rim.outer_m, rim.inner_m])))[side]
    fixed = np.round(lines * 2**SUBPIXEL_BITS).astype(np.int32)
    cv2.polylines(picture, list(fixed.reshape(-1, rim.shape[1], 1, 2)), False, GREEN, 1, cv2.LINE_AA, SUBPIXEL_BITS)
    origin, tip = stereo.project(pose_camera_hole.apply(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.03]])))[side]
    cv2.arrowedLine(picture, _pixel(origin), _pixel(tip), BLUE, 1, cv2.LINE_AA)
    low, high = np.floor(lines[0].min(axis=(0, 1))).astype(int), np.ceil(lines[0].max(axis=(0, 1))).astype(int)
    return _framed(picture, side, (int(low[0]), int(low[1]), int(high[0]), int(high[1])), origin)


def _framed(
    picture: NDArray[np.uint8], side: int, box_px: tuple[int, int, int, int], centre: NDArray[np.float64]
) -> Grey:
    left, top, right, bottom = box_px
    cv2.rectangle(picture, (left - 6, top - 6), (right + 6, bottom + 6), RED, 1)
    cv2.circle(picture, _pixel(centre), 2, RED, -1, cv2.LINE_AA)
    u, v = centre
    text = f"{('left', 'right')[side]} ({u:.1f}, {v:.1f})"
    cv2.putText(picture, text, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, RED, 1, cv2.LINE_AA)
    return np.asarray(picture, dtype=np.uint8)


def _pixel(point: NDArray[np.float64]) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
