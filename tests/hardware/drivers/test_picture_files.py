"""The driver that shows picture files: what it gives, and what it says of files that are wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.messages import CaptureStereo
from services.hardware.config import HardwareConfig
from services.hardware.hosting import open_cell
from services.operator.bench.pictures.camera.cameras import cell_pair

SIZE = (480, 640)


def _files(folder: Path, dtype: type[np.generic] = np.uint8, shape: tuple[int, ...] = SIZE) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    paths: dict[str, Any] = {}
    for side in ("left", "right"):
        picture = rng.integers(0, np.iinfo(np.uint8).max, shape).astype(dtype)
        path = folder / f"{side}.png"
        assert cv2.imwrite(str(path), picture)
        paths[side] = [path]
    calibration = folder / "calibration.json"
    calibration.write_text(json.dumps(cell_pair().said()), encoding="utf-8")
    return {**paths, "calibration": calibration}


def _read(path: Path) -> Any:
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    return picture


def _config(pictures: dict[str, Any], **more: Any) -> HardwareConfig:
    return HardwareConfig.model_validate({"drivers": {"camera": "pictures"}, "pictures": pictures, **more})


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_the_files_are_what_the_cameras_of_a_simulated_arm_see(tmp_path: Path, dtype: type[np.generic]) -> None:
    said = _files(tmp_path, dtype)
    cell = open_cell(Workcell(), _config(said), realtime=False)
    try:
        assert cell.has_simulation
        camera = cell.camera
        assert camera is not None
        for _ in range(2):  # the last pair is given over again
            taken = camera.capture(CaptureStereo())
            assert taken.left.dtype == dtype
            assert np.array_equal(taken.left, _read(said["left"][0]))
            assert np.array_equal(taken.right, _read(said["right"][0]))
        assert camera.calibration().pose_left_right.position_m == pytest.approx((0.05, 0.0, 0.0))
    finally:
        cell.close()


def test_colour_is_given_as_rgb(tmp_path: Path) -> None:
    said = _files(tmp_path, shape=(*SIZE, 3))
    cell = open_cell(Workcell(), _config(said), realtime=False)
    try:
        assert cell.camera is not None
        left = cell.camera.capture(CaptureStereo()).left
        assert np.array_equal(left[..., ::-1], _read(said["left"][0]))
    finally:
        cell.close()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"left": []}, r"hardware\.pictures\.left, right: 0 and 1 files"),
        ({"left": ["nowhere.png"]}, r"hardware\.pictures\.left: nowhere\.png is no picture"),
        ({"calibration": None}, r"hardware\.pictures\.calibration: names no file"),
        ({"calibration": "nowhere.json"}, r"hardware\.pictures\.calibration: nowhere\.json cannot be read"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        open_cell(Workcell(), _config({**_files(tmp_path), **change}), realtime=False)


def test_without_a_place_of_its_own_the_camera_stands_where_the_cell_has_it(tmp_path: Path) -> None:
    said = _files(tmp_path)
    content = json.loads(said["calibration"].read_text(encoding="utf-8"))
    del content["pose_base_camera"]
    said["calibration"].write_text(json.dumps(content), encoding="utf-8")
    cell = open_cell(Workcell(), _config(said), realtime=False)
    try:
        pose = cell.camera.calibration().pose_base_camera.pose()
        assert np.allclose(pose.matrix(), Workcell().camera.pose_base_camera().matrix())
    finally:
        cell.close()


def test_a_picture_of_another_size_than_the_calibration_says_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"left\.png is 320 x 240, the calibration says 640 x 480"):
        open_cell(Workcell(), _config(_files(tmp_path, shape=(240, 320))), realtime=False)


def test_a_field_of_the_calibration_that_is_missing_is_named(tmp_path: Path) -> None:
    said = _files(tmp_path)
    content = json.loads(said["calibration"].read_text(encoding="utf-8"))
    del content["left"]["fx_px"]
    said["calibration"].write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"calibration\.json: left\.fx_px"):
        open_cell(Workcell(), _config(said), realtime=False)


def test_it_is_a_driver_for_cameras_alone(tmp_path: Path) -> None:
    config = HardwareConfig.model_validate({"driver": "pictures", "pictures": _files(tmp_path)})
    with pytest.raises(ConfigError, match="pictures opens no arm"):
        open_cell(Workcell(), config, realtime=False)
