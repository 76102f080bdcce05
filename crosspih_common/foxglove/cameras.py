"""A camera as Foxglove's CameraCalibration, and the hole's rims drawn over its picture."""

from __future__ import annotations

from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration as CalibrationMessage
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation

from crosspih_common.foxglove.primitives import Rgba, color, stamp
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraModel, DistortionModel
from crosspih_common.messages.camera import MAX_PLUMB_BOB

# Foxglove's names of what we call plumb_bob and fisheye
PLUMB_BOB, RATIONAL, KANNALA_BRANDT = "plumb_bob", "rational_polynomial", "kannala_brandt"
FEW = 5  # coefficients of Foxglove's plumb_bob; more are its rational_polynomial
NEAREST_M = 0.01
OUTER_RIM: Rgba = (1.0, 0.75, 0.0, 1.0)
INNER_RIM: Rgba = (0.0, 1.0, 0.4, 1.0)


def calibration_message(camera: CameraModel, frame: str, stamp_ns: int) -> bytes:
    """CameraCalibration of unrectified pictures: R is empty and P is K."""
    given = [float(value) for value in camera.distortion]
    if camera.distortion_model is DistortionModel.FISHEYE:
        model, numbers = KANNALA_BRANDT, given
    else:
        many = len(given) > FEW
        model = RATIONAL if many else PLUMB_BOB
        numbers = given + [0.0] * ((MAX_PLUMB_BOB if many else FEW) - len(given))
    fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    message = CalibrationMessage(
        timestamp=stamp(stamp_ns), frame_id=frame, width=camera.width_px, height=camera.height_px,
        distortion_model=model, D=numbers, K=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )  # fmt: skip
    return bytes(message.SerializeToString())


def pixels_of(camera: CameraModel, points_m: Array) -> Array:
    """Pixels (n, 2) of points (n, 3) in the camera's frame, m; NaN for points behind the camera."""
    z = np.where(points_m[:, 2] > NEAREST_M, points_m[:, 2], np.nan)
    x, y = points_m[:, 0] / z, points_m[:, 1] / z
    if camera.distortion_model is DistortionModel.FISHEYE:
        radius = np.maximum(np.hypot(x, y), 1e-12)
        angle = np.arctan(radius)
        powers = angle[:, None] ** np.arange(2, 10, 2)
        ratio = angle * (1.0 + powers @ np.asarray(camera.distortion)) / radius
        x, y = x * ratio, y * ratio
    elif any(camera.distortion):
        k1, k2, p1, p2, k3, k4, k5, k6 = (*camera.distortion, *(0.0,) * (MAX_PLUMB_BOB - len(camera.distortion)))
        r2 = x * x + y * y
        bent = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        x, y = (
            x * bent + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * bent + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    return np.column_stack([camera.fx_px * x + camera.cx_px, camera.fy_px * y + camera.cy_px])


def rim_annotations(camera: CameraModel, pose_camera_hole: Pose, rims_m: list[Array], stamp_ns: int) -> bytes:
    """ImageAnnotations of the rims (n, 3), in the hole's frame: the outer one first."""
    when = stamp(stamp_ns)
    message: Any = ImageAnnotations(timestamp=when)
    for rim, rgba in zip(rims_m, (OUTER_RIM, INNER_RIM), strict=False):
        pixels = pixels_of(camera, pose_camera_hole.apply(rim))
        if not np.isfinite(pixels).all():
            continue
        message.points.add(
            timestamp=when, type=PointsAnnotation.LINE_LOOP, outline_color=color(rgba), thickness=1.0,
            points=[Point2(x=x, y=y) for x, y in pixels.tolist()],
        )  # fmt: skip
    return bytes(message.SerializeToString())
