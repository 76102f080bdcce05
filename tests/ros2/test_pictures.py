"""Pictures and camera_infos to ROS and back, and against OpenCV and our own reader of camera_infos."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rosbags")

import cv2

from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration, CameraModel, DistortionModel, Image, PoseData
from crosspih_common.messages.images import ENCODINGS, Pixels
from crosspih_common.ros2 import RosTypes
from crosspih_common.ros2.converting import Converter
from crosspih_common.ros2.stereo import calibration_of, camera_infos
from services.hardware.drivers.ros2.camera import camera_info, pixels_of
from services.operator.locate.camera_info import message_of

TYPES = RosTypes()
CONVERT = Converter(TYPES)
BASE = Pose.from_rotvec([0.1, 0.2, 0.3], [1.0, 2.0, 3.0])


@pytest.mark.parametrize("encoding", [name for name in ENCODINGS if name != "mono16be"])
def test_a_picture_comes_back_as_it_was(encoding: str) -> None:
    kind, channels = ENCODINGS[encoding]
    shape = (5, 7, 3) if channels == 3 else (5, 7)
    most = 255 if kind == "u1" else 65535
    pixels: Pixels = np.random.default_rng(3).integers(0, most, shape).astype(np.uint8 if kind == "u1" else np.uint16)
    message = CONVERT.image(Image("camera_left", pixels, 5, encoding=encoding), 5)
    read = TYPES.decode(TYPES.encode(message), "sensor_msgs/msg/Image")
    back, name = pixels_of(read)
    assert np.array_equal(back, pixels) and back.dtype == pixels.dtype and name == encoding
    assert (read.header.stamp.sec, read.header.stamp.nanosec, read.header.frame_id) == (0, 5, "camera_left")


def image(**changes: Any) -> Any:
    fields = {
        "height": 2,
        "width": 3,
        "encoding": "mono8",
        "is_bigendian": 0,
        "step": 3,
        "data": np.arange(6, dtype=np.uint8),
    }
    return TYPES.make("sensor_msgs/msg/Image", header=CONVERT.header(0, "c"), **{**fields, **changes})


def test_padded_rows_big_endian_numbers_and_opencvs_names_are_read() -> None:
    padded = image(step=4, data=np.array([1, 2, 3, 99, 4, 5, 6, 99], np.uint8))
    assert pixels_of(padded)[0].tolist() == [[1, 2, 3], [4, 5, 6]]
    big = image(encoding="mono16", is_bigendian=1, step=6, data=np.arange(6, dtype=">u2").view(np.uint8))
    assert pixels_of(big)[0].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert pixels_of(image(encoding="8UC1"))[1] == "mono8"
    for changes, why in (({"encoding": "yuv422"}, "yuv422"), ({"height": 9}, "too few"), ({"step": 2}, "too few")):
        with pytest.raises(ValueError, match=why):
            pixels_of(image(**changes))


def calibrations() -> st.SearchStrategy[CameraCalibration]:
    small, bend = st.floats(-0.08, 0.08), st.floats(-0.2, 0.2)

    def camera(fx: float, cx: float, distortion: list[float]) -> CameraModel:
        model = DistortionModel.PLUMB_BOB if any(distortion) else DistortionModel.NONE
        return CameraModel(
            width_px=640, height_px=480, fx_px=fx, fy_px=fx * 1.01, cx_px=cx, cy_px=240.0, distortion_model=model,
            distortion=tuple(distortion) if any(distortion) else (),
        )  # fmt: skip

    def both(left: CameraModel, right: CameraModel, turn: list[float], aside: list[float]) -> CameraCalibration:
        pose = Pose.from_rotvec(turn, [0.06, aside[0], aside[1]])
        return CameraCalibration(
            stamp_ns=0, left=left, right=right, pose_left_right=PoseData.of(pose), pose_base_camera=PoseData.of(BASE)
        )

    cameras = st.builds(
        camera, st.floats(300.0, 900.0), st.floats(300.0, 340.0), st.lists(bend, min_size=5, max_size=8)
    )  # fmt: skip
    pair = st.lists(small, min_size=3, max_size=3), st.lists(st.floats(-0.005, 0.005), min_size=2, max_size=2)
    return st.builds(both, cameras, cameras, *pair)


@given(calibrations())
def test_a_calibration_comes_back_by_two_readers(calibration: CameraCalibration) -> None:
    messages = CONVERT.camera_infos(calibration, ("camera_left", "camera_right"), 9)
    read = [camera_info(TYPES.decode(TYPES.encode(one), "sensor_msgs/msg/CameraInfo")) for one in messages]
    back = calibration_of(read[0], read[1], BASE, rectified=False)
    as_dicts: list[dict[str, Any]] = [
        {
            "k": one.k.ravel().tolist(), "d": one.d.tolist(), "r": one.r.ravel().tolist(), "p": one.p.ravel().tolist(),
            "width": one.width, "height": one.height, "distortion_model": one.model,
        }
        for one in read
    ]  # fmt: skip
    by_operator = CameraCalibration.model_validate(
        {**message_of(as_dicts[0], as_dicts[1], 1.0, False), "stamp_ns": 0, "pose_base_camera": PoseData.of(BASE)}
    )
    for found in (back, by_operator):
        for side in ("left", "right"):
            told, given_ = getattr(found, side), getattr(calibration, side)
            assert (told.fx_px, told.fy_px, told.cx_px, told.cy_px) == (
                given_.fx_px, given_.fy_px, given_.cx_px, given_.cy_px,
            )  # fmt: skip
            rest = np.zeros(8)
            rest[: len(told.distortion)] = told.distortion
            rest[: len(given_.distortion)] -= given_.distortion
            assert not rest.any()
        pose = calibration.pose_left_right.pose()
        assert np.allclose(found.pose_left_right.pose().matrix(), pose.matrix(), atol=1e-9)


def test_the_rectification_is_one_that_opencv_makes() -> None:
    """OpenCV's rectified cameras look another way about the baseline; across it they are the same."""
    model = CameraModel(width_px=640, height_px=480, fx_px=500.0, fy_px=500.0, cx_px=320.0, cy_px=240.0)
    pose = Pose.from_rotvec([0.02, -0.03, 0.01], [0.06, 0.001, -0.002])
    calibration = CameraCalibration(
        stamp_ns=0, left=model, right=model, pose_left_right=PoseData.of(pose), pose_base_camera=PoseData.of(BASE)
    )
    left, right = camera_infos(calibration)
    to_right = pose.inverse()
    r1, r2, *_ = cv2.stereoRectify(
        left.k,
        np.zeros(5),
        right.k,
        np.zeros(5),
        (640, 480),
        to_right.rotation,
        to_right.translation_m[:, None],
    )
    assert np.allclose(r1[0], left.r[0], atol=1e-9) and np.allclose(r2[0], right.r[0], atol=1e-9)
    # a point that both see lies in one row of both rectified pictures
    point = np.array([0.05, -0.04, 0.6])
    in_right = to_right.apply(point)
    rows = [(info.p @ np.append(info.r @ seen, 1.0)) for info, seen in ((left, point), (right, in_right))]
    assert rows[0][1] / rows[0][2] == pytest.approx(rows[1][1] / rows[1][2], abs=1e-9)


def test_what_is_no_pair_is_named() -> None:
    model = CameraModel(width_px=640, height_px=480, fx_px=500.0, fy_px=500.0, cx_px=320.0, cy_px=240.0)
    pose = PoseData.of(Pose.from_translation([0.06, 0.0, 0.0]))
    calibration = CameraCalibration(
        stamp_ns=0, left=model, right=model, pose_left_right=pose, pose_base_camera=PoseData.of(BASE)
    )
    left, right = camera_infos(calibration)
    with pytest.raises(ValueError, match=r"-0.06 m to the right of the left one; name the left"):
        calibration_of(right, left, BASE, rectified=False)
    empty = camera_info(CONVERT._make("sensor_msgs/msg/CameraInfo", header=CONVERT.header(0, "c"), height=0, width=0,
                        distortion_model="", d=np.zeros(0), k=np.zeros(9), r=np.zeros(9), p=np.zeros(12), binning_x=0,
                        binning_y=0, roi=CONVERT._make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0,
                        height=0, width=0, do_rectify=False)))  # fmt: skip
    with pytest.raises(ValueError, match="left camera_info is empty"):
        calibration_of(empty, right, BASE, rectified=False)
