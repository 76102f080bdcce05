"""Cameras of any lens, unequal and not parallel: OpenCV is the second witness of projection and triangulation."""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from crosspih_common.bus.codec import decode
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, CameraModel, DistortionModel, PoseData, StereoPair
from services.vision.stereo import Camera, StereoModel

LENSES: dict[str, dict[str, Any]] = {
    "none": {},
    "barrel": {"distortion_model": "plumb_bob", "distortion": (-0.3, 0.09, 1e-3, -7e-4, -0.01)},
    "rational": {"distortion_model": "plumb_bob", "distortion": (0.4, -0.1, 5e-4, 8e-4, 0.02, 0.7, -0.05, 0.01)},
    "k1 alone": {"distortion_model": "plumb_bob", "distortion": (-0.3,)},
    "fisheye": {"distortion_model": "fisheye", "distortion": (0.05, -0.02, 0.004, -0.001)},
}
FLAT: dict[str, Any] = {
    "width_px": 640, "height_px": 480, "fx_px": 381.36, "fy_px": 380.0, "cx_px": 320.5, "cy_px": 240.5,
    "baseline_m": 0.05,
    "pose_base_camera": {"position_m": [0.1, 0.2, 0.3], "quaternion_xyzw": [-0.5, 0.5, -0.5, 0.5]},
}  # fmt: skip


def camera_of(lens: str, scale: float = 1.0) -> CameraModel:
    return CameraModel(
        width_px=round(640 * scale), height_px=round(480 * scale), fx_px=400.0 * scale, fy_px=395.0 * scale,
        cx_px=322.0 * scale, cy_px=236.0 * scale, **LENSES[lens],
    )  # fmt: skip


def by_opencv(camera: CameraModel, pose_camera: Pose, points: Array) -> Array:
    """Pixels (n, 2) of points (n, 3) in a frame in which the camera stands at `pose_camera`."""
    matrix = np.array([[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]])
    seen = pose_camera.inverse()
    rows = np.ascontiguousarray(points).reshape(-1, 1, 3)
    if camera.distortion_model is DistortionModel.FISHEYE:
        pixels, _ = cv2.fisheye.projectPoints(
            rows, seen.rotvec_rad(), seen.translation_m, matrix, np.array(camera.distortion)
        )
    else:
        distortion = np.zeros(8)
        distortion[: len(camera.distortion)] = camera.distortion
        pixels, _ = cv2.projectPoints(rows, seen.rotvec_rad(), seen.translation_m, matrix, distortion)
    return np.asarray(pixels, dtype=float).reshape(-1, 2)


def stereo_of(left: CameraModel, right: CameraModel, pose_left_right: Pose) -> StereoModel:
    return StereoModel.of(
        CameraCalibration(
            left=left, right=right, pose_left_right=PoseData.of(pose_left_right),
            pose_base_camera=PoseData.of(Pose.identity()),
        )
    )  # fmt: skip


EXACT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
# OpenCV 4 has the one with a criterion under a name of its own
UNDISTORT: Any = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
POINTS = np.random.default_rng(3).uniform([-0.1, -0.08, 0.25], [0.1, 0.08, 0.45], (60, 3))
TOED_IN = Pose.from_rotvec([0.03, -0.25, 0.1], [0.08, -0.015, 0.01])


@pytest.mark.parametrize("right", LENSES)
@pytest.mark.parametrize("left", LENSES)
def test_any_two_cameras_project_as_opencv_does_and_triangulation_undoes_it(left: str, right: str) -> None:
    told = camera_of(left), camera_of(right, 2.5)
    stereo = stereo_of(*told, TOED_IN)
    pixels = stereo.project(POINTS)
    for side, pose in enumerate((Pose.identity(), TOED_IN)):
        assert pixels[side] == pytest.approx(by_opencv(told[side], pose, POINTS), abs=1e-9)
    assert stereo.sizes_px == ((640, 480), (1600, 1200))
    assert stereo.triangulate(pixels[0], pixels[1]) == pytest.approx(POINTS, abs=1e-9)
    assert stereo.triangulate(pixels[0, 0], pixels[1, 0]) == pytest.approx(POINTS[0], abs=1e-9)
    assert stereo.apart_px(pixels[0], pixels[1]) == pytest.approx(np.zeros((60, 2)), abs=1e-6)


@pytest.mark.parametrize("lens", LENSES)
def test_rays_are_those_of_cv2_undistort_points(lens: str) -> None:
    told = camera_of(lens)
    camera = Camera.of(told)
    pixels = camera.project(POINTS)
    matrix = np.array([[told.fx_px, 0.0, told.cx_px], [0.0, told.fy_px, told.cy_px], [0.0, 0.0, 1.0]])
    rows = np.ascontiguousarray(pixels).reshape(-1, 1, 2)
    seen: Any
    if lens == "fisheye":
        seen = cv2.fisheye.undistortPoints(rows, matrix, np.array(told.distortion), criteria=EXACT)
    else:
        numbers = np.zeros(8)
        numbers[: len(told.distortion)] = told.distortion
        seen = UNDISTORT(rows, matrix, numbers, criteria=EXACT)
    assert camera.slopes(pixels) == pytest.approx(np.asarray(seen).reshape(-1, 2), abs=1e-7)


def test_a_point_rectified_by_opencv_is_the_point_triangulated() -> None:
    """cv2.stereoRectify and cv2.undistortPoints, then the disparity: another way to the same point."""
    left, right = camera_of("barrel"), camera_of("rational", 1.0)
    stereo = stereo_of(left, right, TOED_IN)
    to_right = TOED_IN.inverse()
    matrices = [np.array([[c.fx_px, 0, c.cx_px], [0, c.fy_px, c.cy_px], [0, 0, 1.0]]) for c in (left, right)]
    bends = [np.array([*c.distortion, *[0.0] * (8 - len(c.distortion))]) for c in (left, right)]
    r1, r2, p1, p2, q, *_ = cv2.stereoRectify(
        matrices[0],
        bends[0],
        matrices[1],
        bends[1],
        (640, 480),
        to_right.rotation,
        to_right.translation_m.reshape(3, 1),
    )
    pixels = stereo.project(POINTS)
    flat = [
        UNDISTORT(np.ascontiguousarray(pixels[k]).reshape(-1, 1, 2), matrices[k], bends[k], R=r, P=p, criteria=EXACT)
        for k, (r, p) in enumerate(((r1, p1), (r2, p2)))
    ]
    one, other = (np.asarray(rows).reshape(-1, 2) for rows in flat)
    assert one[:, 1] == pytest.approx(other[:, 1], abs=1e-4)
    found: Any = np.column_stack([one, one[:, 0] - other[:, 0], np.ones(len(one))]) @ np.asarray(q).T
    found = (found[:, :3] / found[:, 3:]) @ np.asarray(r1)  # from the rectified left camera's axes to the camera's own
    assert stereo.triangulate(pixels[0], pixels[1]) == pytest.approx(found, abs=1e-6)


@given(st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-0.002, 0.002), st.floats(-0.4, 0.4), st.floats(-0.3, 0.3))
def test_a_lens_is_undone_wherever_it_can_be(k1: float, k2: float, p1: float, x: float, y: float) -> None:
    told = CameraModel(
        width_px=640, height_px=480, fx_px=400.0, fy_px=400.0, cx_px=320.0, cy_px=240.0,
        distortion_model=DistortionModel.PLUMB_BOB, distortion=(k1, k2, p1),
    )  # fmt: skip
    camera = Camera.of(told)
    assert camera.slopes(camera.project(np.array([x, y, 1.0]))) == pytest.approx(np.array([x, y]), abs=1e-8)


def test_a_pixel_that_the_lens_never_meets_has_no_ray() -> None:
    camera = Camera.of(camera_of("k1 alone"))
    assert np.isnan(camera.slopes(np.array([0.0, 0.0]))).all()
    assert np.isfinite(camera.slopes(np.array([100.0, 100.0]))).all()


def test_pixels_that_belong_to_no_point_are_told() -> None:
    stereo = StereoModel.parallel(640, 480, 400.0, 400.0, 320.0, 240.0, 0.05, Pose.identity())
    left, right = stereo.project(np.array([0.01, 0.02, 0.3]))
    assert stereo.triangulate(right, left)[2] == pytest.approx(-0.3)  # swapped
    assert not np.isfinite(stereo.triangulate(left, left)).all()  # parallel rays
    assert stereo.apart_px(left + np.array([0.0, 3.0]), right) == pytest.approx([0.0, 3.0], abs=1e-6)


def test_the_calibration_of_before_is_two_equal_parallel_cameras() -> None:
    read = CameraCalibration.model_validate_json(json.dumps({**FLAT, "frame": "base", "stamp_ns": 5, "seq": 2}))
    assert (read.stamp_ns, read.seq, read.left, read.left.fy_px) == (5, 2, read.right, 380.0)
    assert read.pose_left_right.position_m == (0.05, 0.0, 0.0)
    assert CameraCalibration.model_validate_json(read.model_dump_json()) == read
    pair = json.dumps({"stamp_ns": 9, "capture_id": 1, "exposure_s": 0.02, "calibration": FLAT}).encode()
    assert decode(StereoPair, pair, "crosspih.StereoPair/1 4", "k").calibration.left == read.left  # of a recording
    pixels = StereoModel.of(read).project(np.array([0.01, 0.02, 0.4]))
    assert pixels[0, 0] - pixels[1, 0] == pytest.approx(381.36 * 0.05 / 0.4)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"baseline_m": 0.0}, "baseline_m"),
        ({"baseline_m": "wide"}, "baseline_m"),
        ({"fx_px": -1.0}, "fx_px"),
        ({"hurry": 1}, "hurry"),
    ],
)
def test_a_wrong_calibration_of_before_is_still_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        CameraCalibration.model_validate({**FLAT, **change})


@pytest.mark.parametrize(
    ("lens", "said"),
    [
        ({"distortion": (0.1,)}, "distortion_model is none"),
        ({"distortion_model": "plumb_bob", "distortion": (0.0,) * 9}, "at most 8"),
        ({"distortion_model": "fisheye", "distortion": (0.1,)}, "give 4"),
        ({"distortion_model": "barrel"}, "distortion_model"),
        ({"gamma": 2.2}, "gamma"),
    ],
)
def test_a_lens_that_is_not_one_is_refused(lens: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        CameraModel.model_validate({**camera_of("none").model_dump(), **lens})
