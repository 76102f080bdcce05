"""The picture for a refusal: the expected place of the hole by the cell's file, and the reason for the refusal."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from services.vision.annotate import BLUE, RED, SUBPIXEL_BITS
from services.vision.fit.rim import Rimmed
from services.vision.stereo import StereoModel


def expected_picture(
    grey: NDArray[np.uint8], side: int, stereo: StereoModel, hole: Rimmed, nominal: Pose, code: str
) -> NDArray[np.uint8]:
    """RGB picture of one side (0 left, 1 right): the rim by drawing and prior, in blue."""
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB)
    points = (stereo.pose_base_camera.inverse() @ nominal).apply(hole.outer_rim_m())
    if np.all(points[:, 2] > 0.0):
        rim = stereo.project(points)[side]
        if np.all(np.abs(rim) < 2**15):  # cv2 draws with 32-bit fixed-point coordinates
            fixed = np.round(rim * 2**SUBPIXEL_BITS).astype(np.int32)
            cv2.polylines(picture, [fixed.reshape(-1, 1, 2)], True, BLUE, 1, cv2.LINE_AA, SUBPIXEL_BITS)
    text = f"{('left', 'right')[side]}: {code}; blue: where it is expected"
    cv2.putText(picture, text, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, RED, 1, cv2.LINE_AA)
    return np.asarray(picture, dtype=np.uint8)
