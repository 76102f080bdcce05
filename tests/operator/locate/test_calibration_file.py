"""Calibration files as users have them: the camera message, ROS camera_info, and what OpenCV's FileStorage writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration, Gamma
from services.operator.locate.calibration_file import FileReading, read_calibration
from services.operator.locate.reading import CameraFileError

BASE = Pose.from_rotvec([0.1, 0.2, 0.3], [0.4, 0.5, 0.6])
READING = FileReading(BASE)
M1 = np.array([[400.0, 0.0, 322.0], [0.0, 395.0, 236.0], [0.0, 0.0, 1.0]])
M2 = np.array([[410.0, 0.0, 318.0], [0.0, 407.0, 243.0], [0.0, 0.0, 1.0]])
D1, D2 = np.array([[-0.3, 0.09, 1e-3, -7e-4, -0.01]]), np.array([[0.1, -0.05, 0.0, 1e-4, 0.0, 0.01, 0.0, 0.0]])
RIGHT = Pose.from_rotvec([0.02, -0.1, 0.03], [0.06, 0.002, -0.004])  # in the left one's frame
ROTATION, SHIFT = RIGHT.inverse().rotation, RIGHT.inverse().translation_m.reshape(3, 1)
SIZE = {"image_width": 640, "image_height": 480}
PLACED = "image_width: 640\nimage_height: 480\nR: [0, 0, 0]\nT: [1, 0, 0]"
MESSAGE: dict[str, Any] = {
    "left": {"width_px": 640, "height_px": 480, "fx_px": 400, "fy_px": 395, "cx_px": 322, "cy_px": 236},
    "right": {"width_px": 800, "height_px": 600, "fx_px": 410, "fy_px": 407, "cx_px": 318, "cy_px": 243,
              "distortion_model": "plumb_bob", "distortion": ["-1e-1", 0.01], "gamma": "srgb"},
    "pose_left_right": {"position_m": [0.06, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]},
}  # fmt: skip


def store(path: Path, **values: Any) -> Path:
    """As OpenCV writes it."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        storage.write(name, value)
    storage.release()
    return path


def text(path: Path, value: Any) -> Path:
    path.write_text(json.dumps(value) if path.suffix == ".json" else yaml.safe_dump(value), encoding="utf-8")
    return path


def require_stereo(read: CameraCalibration) -> None:
    """It is the stereo pair of this file: by what it projects, OpenCV being the witness."""
    points = np.random.default_rng(0).uniform([-0.1, -0.1, 0.3], [0.1, 0.1, 0.5], (20, 3))
    to_right = read.pose_left_right.pose().inverse()
    for camera, pose, matrix, bend in (
        (read.left, Pose.identity(), M1, D1),
        (read.right, RIGHT.inverse(), M2, D2),
    ):
        numbers = np.zeros(8)
        numbers[: len(camera.distortion)] = camera.distortion
        told = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1.0]])
        own = Pose.identity() if camera is read.left else to_right
        found, _ = cv2.projectPoints(points, own.rotvec_rad(), own.translation_m, told, numbers)
        want, _ = cv2.projectPoints(points, pose.rotvec_rad(), pose.translation_m, matrix, bend)
        assert np.asarray(found) == pytest.approx(np.asarray(want), abs=1e-6)
        assert (camera.width_px, camera.height_px) == (640, 480)


@pytest.mark.parametrize("suffix", ["yaml", "json"])
def test_the_camera_message_is_read(tmp_path: Path, suffix: str) -> None:
    read = read_calibration([text(tmp_path / f"c.{suffix}", MESSAGE)], READING)
    assert read.right.distortion == (-0.1, 0.01) and read.right.gamma is Gamma.SRGB and read.right.width_px == 800
    assert read.pose_base_camera.pose().distance_to_m(BASE) < 1e-12  # it says nothing of it
    stands = {"position_m": [1, 2, 3], "quaternion_xyzw": [0, 0, 0, 1]}
    told = read_calibration([text(tmp_path / f"d.{suffix}", {**MESSAGE, "pose_base_camera": stands})], READING)
    assert told.pose_base_camera.position_m == (1.0, 2.0, 3.0)
    linear = read_calibration([tmp_path / f"d.{suffix}"], FileReading(BASE, gamma=Gamma.LINEAR))
    assert linear.right.gamma is Gamma.LINEAR
    assert read_calibration([text(tmp_path / f"e.{suffix}", told.model_dump(mode="json"))], READING) == told


def test_the_camera_message_of_before_is_read(tmp_path: Path) -> None:
    flat = {**MESSAGE["left"], "baseline_m": 0.05}
    read = read_calibration([text(tmp_path / "c.yaml", flat)], READING)
    assert read.left == read.right and read.pose_left_right.position_m == (0.05, 0.0, 0.0)


@pytest.mark.parametrize("suffix", ["yml", "json"])
def test_what_opencv_writes_is_read(tmp_path: Path, suffix: str) -> None:
    one = store(tmp_path / f"c.{suffix}", M1=M1, D1=D1, M2=M2, D2=D2, R=ROTATION, T=SHIFT, **SIZE)
    require_stereo(read_calibration([one], READING))
    inner = store(tmp_path / f"intrinsics.{suffix}", M1=M1, D1=D1, M2=M2, D2=D2, **SIZE)
    outer = store(tmp_path / f"extrinsics.{suffix}", R=ROTATION, T=SHIFT)
    require_stereo(read_calibration([inner, outer], READING))
    other = store(
        tmp_path / f"other.{suffix}", cameraMatrix1=M1, distCoeffs1=D1.T, cameraMatrix2=M2, distCoeffs2=D2.T,
        R=ROTATION, T=SHIFT.T * 1e3,
    )  # fmt: skip
    with pytest.raises(CameraFileError, match="image_width and image_height"):
        read_calibration([other], READING)
    sizes = (640, 480), (640, 480)
    with pytest.raises(CameraFileError, match="--unit mm"):
        read_calibration([other], FileReading(BASE, sizes=lambda: sizes))
    require_stereo(read_calibration([other], FileReading(BASE, unit_m=1e-3, sizes=lambda: sizes)))


def test_opencvs_rectified_pictures_are_described_by_its_p(tmp_path: Path) -> None:
    _, _, p1, p2, *_ = cv2.stereoRectify(M1, D1, M2, D2, (640, 480), ROTATION, SHIFT)
    path = store(tmp_path / "c.yml", M1=M1, D1=D1, M2=M2, D2=D2, R=ROTATION, T=SHIFT, P1=p1, P2=p2, **SIZE)
    read = read_calibration([path], FileReading(BASE, rectified=True))
    assert read.left.fx_px == pytest.approx(p1[0, 0]) and not any(read.left.distortion)
    assert read.pose_left_right.position_m[0] == pytest.approx(np.linalg.norm(SHIFT))


def test_a_fisheye_of_opencv_says_so(tmp_path: Path) -> None:
    bend = np.array([[0.05], [-0.02], [0.004], [-0.001]])
    path = store(
        tmp_path / "c.yml", M1=M1, D1=bend, M2=M2, D2=bend, R=ROTATION, T=SHIFT, distortion_model="fisheye", **SIZE
    )
    read = read_calibration([path], READING)
    assert read.left.distortion_model.value == "fisheye" and read.left.distortion == (0.05, -0.02, 0.004, -0.001)


def camera_infos() -> list[dict[str, Any]]:
    """As camera_calibration's stereo calibrator writes them: R and P by cv2.stereoRectify."""
    r1, r2, p1, p2, *_ = cv2.stereoRectify(M1, D1, M2, D2, (640, 480), ROTATION, SHIFT)
    return [
        {
            **SIZE, "camera_name": f"narrow_stereo/{side}", "distortion_model": model,
            "camera_matrix": {"rows": 3, "cols": 3, "data": m.ravel().tolist()},
            "distortion_coefficients": {"rows": 1, "cols": d.size, "data": d.ravel().tolist()},
            "rectification_matrix": {"rows": 3, "cols": 3, "data": np.asarray(r).ravel().tolist()},
            "projection_matrix": {"rows": 3, "cols": 4, "data": np.asarray(p).ravel().tolist()},
        }
        for side, model, m, d, r, p in (
            ("left", "plumb_bob", M1, D1, r1, p1), ("right", "rational_polynomial", M2, D2, r2, p2),
        )
    ]  # fmt: skip


def test_ros_camera_info_is_read_from_two_files_and_from_one_with_both(tmp_path: Path) -> None:
    left, right = camera_infos()
    files = [text(tmp_path / "left.yaml", left), text(tmp_path / "right.yaml", right)]
    require_stereo(read_calibration(files, READING))
    require_stereo(read_calibration([text(tmp_path / "both.yaml", {"left": left, "right": right})], READING))
    stream = tmp_path / "stream.yaml"
    stream.write_text("\n---\n".join(yaml.safe_dump(info) for info in (left, right)), encoding="utf-8")
    require_stereo(read_calibration([stream], READING))
    with pytest.raises(CameraFileError, match="left camera's camera_info first"):
        read_calibration(files[::-1], READING)
    with pytest.raises(CameraFileError, match="1 camera; give that of both"):
        read_calibration(files[:1], READING)


def test_a_printed_camera_info_message_is_read_and_rectified_pictures_are_described_by_p(tmp_path: Path) -> None:
    files = []
    for case, info in zip(("upper", "lower"), camera_infos(), strict=True):
        short = {"K": "camera_matrix", "D": "distortion_coefficients", "R": "rectification_matrix"}
        told = {name: info[long]["data"] for name, long in (*short.items(), ("P", "projection_matrix"))}
        if case == "lower":  # ROS 2
            told = {name.lower(): value for name, value in told.items()}
        told |= {"height": 480, "width": 640, "distortion_model": info["distortion_model"], "header": {"frame_id": "c"}}
        files.append(text(tmp_path / f"{case}.yaml", told))
    require_stereo(read_calibration(files, READING))
    flat = read_calibration(files, FileReading(BASE, rectified=True))
    assert flat.left.fx_px == flat.right.fx_px == pytest.approx(camera_infos()[0]["projection_matrix"]["data"][0])
    assert flat.pose_left_right.position_m == pytest.approx((float(np.linalg.norm(SHIFT)), 0.0, 0.0))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("left: [1,", "neither YAML nor JSON"),
        ("- 1\n- 2", "holds no fields"),
        ("", "holds no fields"),
        ("a: 1", "none of the camera message"),
        (yaml.safe_dump({**MESSAGE, "pose_left_right": {"position_m": [1, 0, 0]}}), "pose_left_right.quaternion_xyzw"),
        (yaml.safe_dump({**MESSAGE, "left": {**MESSAGE["left"], "fx_px": -1}}), "left.fx_px"),
        (yaml.safe_dump({**MESSAGE, "lens": 1}), "lens"),
        (yaml.safe_dump({"left": MESSAGE["left"], "right": MESSAGE["right"]}), "pose_left_right is missing"),
        (f"M1: [1, 2]\n{PLACED}", "M1 has 2 numbers; give 9"),
        (f"M1: {{data: [a]}}\n{PLACED}", "M1 is not a list of numbers"),
        ("M1: [1]\nimage_width: -3", "image_width is -3"),
        ("M1: [1]\nimage_width: 640\nimage_height: 480", "R is missing"),
        (f"M1: [1]\n{PLACED}\nR: [2, 0, 0, 0, 2, 0, 0, 0, 2]", "R is no rotation"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used_is_told_its_field(tmp_path: Path, content: str, said: str) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(CameraFileError, match="calibration: ") as refused:
        read_calibration([path], READING)
    assert said in str(refused.value)


def test_a_file_that_is_not_there_or_no_text_is_told(tmp_path: Path) -> None:
    with pytest.raises(CameraFileError, match=r"none\.yaml cannot be read"):
        read_calibration([tmp_path / "none.yaml"], READING)
    (tmp_path / "c.yaml").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(CameraFileError, match="is no text"):
        read_calibration([tmp_path / "c.yaml"], READING)
