"""A stereo pair as two camera_infos: what each camera is, and the rectification that both share.

With R and P a camera sees a point x of its own frame at P (R x) in its rectified picture, and both rectified cameras
look the same way, the right one at -P[3] / P[0] along x (sensor_msgs/CameraInfo).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array, Pose
from crosspih_common.messages import CameraCalibration, CameraModel, DistortionModel, PoseData

# OpenCV's and ROS's names of what we call plumb_bob and fisheye
PLUMB_BOB, RATIONAL, EQUIDISTANT = "plumb_bob", "rational_polynomial", "equidistant"
FEW, MANY = 5, 8  # coefficients of plumb_bob and rational_polynomial


@dataclass(frozen=True, slots=True, eq=False)
class CameraInfo:
    """The numbers of sensor_msgs/CameraInfo: `k` (3, 3), `d` (m,), `r` (3, 3), `p` (3, 4)."""

    width: int
    height: int
    model: str
    d: Array
    k: Array
    r: Array
    p: Array


def camera_infos(calibration: CameraCalibration) -> tuple[CameraInfo, CameraInfo]:
    """Left and right. Both are rectified to the smaller of their focal lengths and the mean of their centres."""
    pose = calibration.pose_left_right.pose()
    x = pose.translation_m / np.linalg.norm(pose.translation_m)
    ahead = np.array([0.0, 0.0, 1.0]) + pose.rotation[:, 2]
    y = np.cross(ahead, x)
    y /= np.linalg.norm(y)
    # rows: the axes that both rectified cameras share, in the left camera's frame
    shared = np.array([x, y, np.cross(x, y)])
    left, right = calibration.left, calibration.right
    focal = min(left.fx_px, left.fy_px, right.fx_px, right.fy_px)
    centre = 0.5 * (left.cx_px + right.cx_px), 0.5 * (left.cy_px + right.cy_px)
    baseline_m = float(np.linalg.norm(pose.translation_m))
    return (
        _info(left, shared, focal, centre, 0.0),
        _info(right, shared @ pose.rotation, focal, centre, -focal * baseline_m),
    )


def _info(camera: CameraModel, turn: Array, focal: float, centre: tuple[float, float], shift: float) -> CameraInfo:
    k = np.array([[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]])
    p = np.array([[focal, 0.0, centre[0], shift], [0.0, focal, centre[1], 0.0], [0.0, 0.0, 1.0, 0.0]])
    given = np.asarray(camera.distortion, float)
    if camera.distortion_model is DistortionModel.FISHEYE:
        model, d = EQUIDISTANT, given
    else:
        many = len(given) > FEW
        model, d = (RATIONAL, np.zeros(MANY)) if many else (PLUMB_BOB, np.zeros(FEW))
        d[: len(given)] = given
    return CameraInfo(camera.width_px, camera.height_px, model, d, k, turn, p)


def calibration_of(left: CameraInfo, right: CameraInfo, pose_base_camera: Pose, rectified: bool) -> CameraCalibration:
    """The inverse; `rectified` is for pictures that are rectified already. ValueError names an invalid number."""
    for side, info in (("left", left), ("right", right)):
        if info.width <= 0 or info.height <= 0 or not info.k[0, 0] > 0.0:
            raise ValueError(f"{side} camera_info is empty ({info.width} x {info.height}, fx {info.k[0, 0]:g}): the "
                             "camera is not calibrated; run camera_calibration's stereo calibration")  # fmt: skip
        if not info.p[0, 0] > 0.0 or np.abs(info.r @ info.r.T - np.eye(3)).max() > 1e-3:
            raise ValueError(f"{side} camera_info has no P, or an R that is no rotation; calibrate both as a pair")
    baseline_m = float(left.p[0, 3] / left.p[0, 0] - right.p[0, 3] / right.p[0, 0])
    if not baseline_m > 0.0:
        raise ValueError(
            f"P says that the right camera stands {baseline_m:g} m to the right of the left one; name the left "
            "camera's topics first, and use the camera_infos of a stereo calibration"
        )
    if rectified:
        cameras = [_camera(info, info.p[:, :3], np.zeros(0)) for info in (left, right)]
        pose = Pose.from_translation([baseline_m, 0.0, 0.0])
    else:
        cameras = [_camera(info, info.k, info.d) for info in (left, right)]
        pose = Pose(left.r.T @ right.r, left.r.T @ np.array([baseline_m, 0.0, 0.0]))
    return CameraCalibration(
        stamp_ns=0, left=cameras[0], right=cameras[1], pose_left_right=PoseData.of(pose),
        pose_base_camera=PoseData.of(pose_base_camera),
    )  # fmt: skip


def _camera(info: CameraInfo, matrix: Array, bend: ArrayLike) -> CameraModel:
    bend = np.asarray(bend, float)
    known = {PLUMB_BOB: DistortionModel.PLUMB_BOB, RATIONAL: DistortionModel.PLUMB_BOB,
             EQUIDISTANT: DistortionModel.FISHEYE}  # fmt: skip
    if bend.any() and info.model not in known:
        raise ValueError(f"distortion_model is {info.model!r}; want {', '.join(known)}")
    straight = not bend.any() and info.model != EQUIDISTANT
    return CameraModel(
        width_px=info.width, height_px=info.height, fx_px=float(matrix[0, 0]), fy_px=float(matrix[1, 1]),
        cx_px=float(matrix[0, 2]), cy_px=float(matrix[1, 2]),
        distortion_model=DistortionModel.NONE if straight or not bend.size else known[info.model],
        distortion=() if straight or not bend.size else tuple(bend.tolist()),
    )  # fmt: skip
