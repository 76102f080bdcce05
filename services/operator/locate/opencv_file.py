"""OpenCV's stereo calibration as its FileStorage writes it: one file, or intrinsics and extrinsics together.

R and T of cv2.stereoCalibrate take a point from the left camera's frame to the right one's: x_right = R x_left + T.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.messages import PoseData
from services.operator.locate.reading import CameraFileError, numbers, whole

NAMES = {
    "M1": ("M1", "cameraMatrix1", "K1", "camera_matrix_1", "CM1", "camera_matrix_left", "cameraMatrixL"),
    "M2": ("M2", "cameraMatrix2", "K2", "camera_matrix_2", "CM2", "camera_matrix_right", "cameraMatrixR"),
    "D1": ("D1", "distCoeffs1", "dist_coeffs_1", "distortion_coefficients_1", "distortion_coefficients_left",
           "distCoeffsL"),
    "D2": ("D2", "distCoeffs2", "dist_coeffs_2", "distortion_coefficients_2", "distortion_coefficients_right",
           "distCoeffsR"),
    "R": ("R", "rotation_matrix", "rotation"),
    "T": ("T", "translation_vector", "translation"),
    "P1": ("P1",),
    "P2": ("P2",),
    "width": ("image_width", "imageWidth", "width"),
    "height": ("image_height", "imageHeight", "height"),
    "size": ("image_size", "imageSize", "size", "img_size"),
}  # fmt: skip
FAR_M = 3.0  # a larger distance between the cameras rather means another unit
TAKEN = 8

Sizes = tuple[tuple[int, int], tuple[int, int]]


def is_one(found: dict[str, Any]) -> bool:
    """Whether the fields are those of a stereo calibration."""
    return any(name in found for name in (*NAMES["M1"], *NAMES["M2"]))


def message_of(
    found: dict[str, Any], unit_m: float, rectified: bool, sizes: Callable[[], Sizes] | None
) -> dict[str, Any]:
    """The camera message's fields, without the pose of the left camera. Raises CalibrationFileError."""
    size = _sizes(found, sizes)
    if rectified:
        projections = [_numbers(found, name, (3, 4)) for name in ("P1", "P2")]
        baseline = float((projections[0][0, 3] - projections[1][0, 3]) / projections[1][0, 0])
        pose = Pose.from_translation([baseline * unit_m, 0.0, 0.0])
        if not baseline > 0.0:
            raise CameraFileError(
                f"calibration: P2 says that the right camera stands {baseline * unit_m:g} m to the right; want above "
                "0, the cameras beside each other"
            )
        cameras = [
            _camera(p, np.zeros(0), one, False, side) for p, one, side in zip(projections, size, "12", strict=True)
        ]
    else:
        given = _numbers(found, "R", (3, 3), (3,))
        shift = _numbers(found, "T", (3,)) * unit_m
        rotation = Pose.from_rotvec(given, [0.0, 0.0, 0.0]).rotation if given.shape == (3,) else given
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3:
            raise CameraFileError("calibration: R is no rotation; give that of cv2.stereoCalibrate")
        pose = Pose(rotation, shift).inverse()
        fisheye = _fisheye(found)
        cameras = [
            _camera(_numbers(found, f"M{side}", (3, 3)), _bend(found, f"D{side}", fisheye), one, fisheye, side)
            for one, side in zip(size, "12", strict=True)
        ]
    apart = float(np.linalg.norm(pose.translation_m))
    if apart > FAR_M:
        raise CameraFileError(
            f"calibration: T puts the cameras {apart:g} m apart; is the file in millimetres? then give --unit mm"
        )
    return {"left": cameras[0], "right": cameras[1], "pose_left_right": PoseData.of(pose)}


def _of(found: dict[str, Any], what: str) -> Any:
    return next((found[name] for name in NAMES[what] if found.get(name) is not None), None)


def _numbers(found: dict[str, Any], what: str, *shapes: tuple[int, ...]) -> Any:
    value = _of(found, what)
    if value is None:
        raise CameraFileError(
            f"calibration: {what} is missing; give what cv2.stereoCalibrate found (M1, D1, M2, D2, R, T), or both "
            "files: --calibration intrinsics.yml --calibration extrinsics.yml"
            if what in ("M1", "M2", "R", "T")
            else f"calibration: {what} is missing; it comes from cv2.stereoRectify"
        )
    return numbers(value, what, *shapes)


def _fisheye(found: dict[str, Any]) -> bool:
    named = str(found.get("distortion_model", "")).lower()
    flagged = any(found.get(name) in (1, True) for name in ("fisheye_model", "fisheye"))
    return flagged or named in ("fisheye", "equidistant")


def _bend(found: dict[str, Any], what: str, fisheye: bool) -> Any:
    value = _of(found, what)
    bend = np.zeros(0) if value is None else numbers(value, what)
    if not fisheye and bend[TAKEN:].any():
        raise CameraFileError(
            f"calibration: {what} has {bend.size} numbers; calibrate with at most {TAKEN} (no thin prism, no "
            "tilted sensor)"
        )
    return bend[:TAKEN]


def _sizes(found: dict[str, Any], sizes: Callable[[], Sizes] | None) -> Sizes:
    both = _of(found, "size")
    if isinstance(both, (list, tuple)) and len(both) == 2:
        size = whole(both[0], "imageSize"), whole(both[1], "imageSize")
    elif _of(found, "width") is not None:
        size = whole(_of(found, "width"), "image_width"), whole(_of(found, "height"), "image_height")
    elif sizes is not None:
        return sizes()
    else:
        raise CameraFileError("calibration: image_width and image_height are missing; give the pictures' size, px")
    return size, size


def _camera(matrix: Any, bend: Any, size: tuple[int, int], fisheye: bool, side: str) -> dict[str, Any]:
    if fisheye and bend.size != 4:
        raise CameraFileError(f"calibration: D{side} has {bend.size} numbers; a fisheye has 4")
    bent = bool(bend.any()) or fisheye
    return {
        "width_px": size[0], "height_px": size[1],
        "fx_px": matrix[0, 0], "fy_px": matrix[1, 1], "cx_px": matrix[0, 2], "cy_px": matrix[1, 2],
        "distortion_model": ("fisheye" if fisheye else "plumb_bob") if bent else "none",
        "distortion": bend.tolist() if bent else [],
    }  # fmt: skip
