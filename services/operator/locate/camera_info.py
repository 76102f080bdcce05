"""ROS camera_info, as camera_calibration writes it (camera_matrix, ...) and as a message prints (K or k, ...).

With R and P a camera sees a point x of its own frame at P (R x) in its rectified picture, and both rectified cameras
look the same way, the right one at -P[3] / P[0] along x (sensor_msgs/CameraInfo).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.messages import PoseData
from services.operator.locate.reading import CameraFileError, numbers, whole

NAMES = {
    "K": ("camera_matrix", "K", "k"),
    "D": ("distortion_coefficients", "D", "d"),
    "R": ("rectification_matrix", "R", "r"),
    "P": ("projection_matrix", "P", "p"),
    "width": ("image_width", "width"),
    "height": ("image_height", "height"),
}
MODELS = {"plumb_bob": "plumb_bob", "rational_polynomial": "plumb_bob", "equidistant": "fisheye", "fisheye": "fisheye"}


def infos_of(document: dict[str, Any]) -> list[dict[str, Any]]:
    """The camera_infos in a document: the document itself, or its fields `left` and `right`."""
    if _of(document, "K") is not None and (_of(document, "P") is not None or "distortion_model" in document):
        return [document]
    both = [document.get("left"), document.get("right")]
    if all(isinstance(one, dict) and _of(one, "K") is not None for one in both):
        return [one for one in both if isinstance(one, dict)]
    return []


def message_of(left: dict[str, Any], right: dict[str, Any], unit_m: float, rectified: bool) -> dict[str, Any]:
    """The camera message's fields, without the pose of the left camera. Raises CalibrationFileError."""
    projections = [_numbers(info, "P", side, (3, 4)) for info, side in ((left, "left"), (right, "right"))]
    offsets = [float(p[0, 3] / p[0, 0]) if p[0, 0] else np.nan for p in projections]
    baseline_m = (offsets[0] - offsets[1]) * unit_m
    if not baseline_m > 0.0:
        raise CameraFileError(
            f"calibration: projection_matrix says that the right camera stands {baseline_m:g} m to the right of the "
            "left one; give the left camera's camera_info first, and that of a stereo calibration"
        )
    if rectified:
        return {
            "left": _rectified(left, projections[0], "left"),
            "right": _rectified(right, projections[1], "right"),
            "pose_left_right": PoseData.of(Pose.from_translation([baseline_m, 0.0, 0.0])),
        }
    turns = [_turn(info, side) for info, side in ((left, "left"), (right, "right"))]
    rotation, position = turns[0].T @ turns[1], turns[0].T @ np.array([baseline_m, 0.0, 0.0])
    return {
        "left": _raw(left, "left"),
        "right": _raw(right, "right"),
        "pose_left_right": PoseData.of(Pose(rotation, position)),
    }


def _of(info: dict[str, Any], what: str) -> Any:
    return next((info[name] for name in NAMES[what] if info.get(name) is not None), None)


def _numbers(info: dict[str, Any], what: str, side: str, *shapes: tuple[int, ...]) -> Any:
    value = _of(info, what)
    if value is None:
        raise CameraFileError(
            f"calibration: {NAMES[what][0]} ({what}) of the {side} camera is missing; give the camera_info of a stereo "
            "calibration"
        )
    return numbers(value, f"{NAMES[what][0]} of the {side} camera", *shapes)


def _turn(info: dict[str, Any], side: str) -> Any:
    turn = (
        numbers(_of(info, "R"), f"rectification_matrix of the {side} camera", (3, 3)) if _of(info, "R") else np.eye(3)
    )
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-3:
        raise CameraFileError(f"calibration: rectification_matrix of the {side} camera is no rotation")
    return turn


def _size(info: dict[str, Any], side: str) -> dict[str, int]:
    return {
        "width_px": whole(_of(info, "width"), f"image_width of the {side} camera"),
        "height_px": whole(_of(info, "height"), f"image_height of the {side} camera"),
    }


def _rectified(info: dict[str, Any], projection: Any, side: str) -> dict[str, Any]:
    return {
        **_size(info, side),
        "fx_px": projection[0, 0], "fy_px": projection[1, 1], "cx_px": projection[0, 2], "cy_px": projection[1, 2],
    }  # fmt: skip


def _raw(info: dict[str, Any], side: str) -> dict[str, Any]:
    matrix = _numbers(info, "K", side, (3, 3))
    given = _of(info, "D")
    bend = np.zeros(0) if given is None else numbers(given, f"distortion_coefficients of the {side} camera")
    name = str(info.get("distortion_model") or ("plumb_bob" if bend.any() else "none"))
    if bend.any() and name not in MODELS:
        raise CameraFileError(
            f"calibration: distortion_model of the {side} camera is {name!r}; want one of {', '.join(MODELS)}"
        )
    model = MODELS.get(name, "none")
    return {
        **_size(info, side),
        "fx_px": matrix[0, 0], "fy_px": matrix[1, 1], "cx_px": matrix[0, 2], "cy_px": matrix[1, 2],
        "distortion_model": model if bend.any() or model == "fisheye" else "none",
        "distortion": bend.tolist() if bend.any() or model == "fisheye" else [],
    }  # fmt: skip
