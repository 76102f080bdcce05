"""Two image topics as the cell's camera, through a real router."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError, DeviceLost
from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration, CameraModel, Image, PoseData
from crosspih_common.ros2 import RosNode, RosQos, RosTypes
from crosspih_common.ros2.converting import Converter
from services.hardware.config import HardwareConfig
from services.hardware.drivers.registry import open_devices
from services.hardware.protocols import CameraDevice

LEFT, RIGHT = "/camera/left/image_raw", "/camera/right/image_raw"
CAMERA = CameraModel(width_px=8, height_px=6, fx_px=5.0, fy_px=5.0, cx_px=3.5, cy_px=2.5)
CALIBRATION = CameraCalibration(
    stamp_ns=0, left=CAMERA, right=CAMERA, pose_left_right=PoseData.of(Pose.from_translation([0.05, 0.0, 0.0])),
    pose_base_camera=PoseData.of(Pose.identity()),
)  # fmt: skip


class Cameras:
    """Two cameras that are triggered together, 50 times a second; the pixels hold the number of the pair."""

    def __init__(self, node: RosNode, apart_ns: int = 0) -> None:
        self._convert, self._apart_ns = Converter(node.types), apart_ns
        kept = RosQos(transient_local=True, depth=1)
        infos = [
            node.publisher(f"/camera/{side}/camera_info", "sensor_msgs/msg/CameraInfo", kept)
            for side in ("left", "right")
        ]
        for publisher, info in zip(infos, self._convert.camera_infos(CALIBRATION, ("l", "r"), 1), strict=True):
            publisher.publish(info)
        self._images = [node.publisher(name, "sensor_msgs/msg/Image") for name in (LEFT, RIGHT)]
        self.shown, self.away = 0, False
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._show, daemon=True)
        self._thread.start()

    def _show(self) -> None:
        while not self._closing.wait(0.02):
            if self.away:
                continue
            number = self.shown + 1
            for index, publisher in enumerate(self._images):
                pixels = np.full((6, 8), number % 200 + index, np.uint8)
                stamp_ns = 1_700_000_000_000_000_000 + number * 20_000_000 + index * self._apart_ns
                publisher.publish(self._convert.image(Image("c", pixels, stamp_ns), stamp_ns))
            self.shown = number

    def close(self) -> None:
        self._closing.set()
        self._thread.join()


@contextmanager
def opened(endpoint: str, cameras: Any = Cameras, **settings: Any) -> Iterator[tuple[CameraDevice, Any]]:
    section = {"endpoint": endpoint, "connect_s": 2.0, "camera": {"wait_s": 2.0, **settings}}
    config = HardwareConfig.model_validate({"driver": "ros2", "ros2": section})
    with RosNode(endpoint, 0, RosTypes(), "cameras") as node:
        showing = cameras(node)
        try:
            devices = open_devices(Workcell(), config, frozenset({"camera"}), True)
            assert devices.camera is not None
            yield devices.camera, showing
            devices.close()
        finally:
            showing.close()


def test_a_capture_is_a_pair_that_was_exposed_after_it_was_asked_for(endpoint: str) -> None:
    with opened(endpoint) as (camera, cameras):
        told = camera.calibration()
        assert (told.left, told.right, told.pose_left_right) == (CAMERA, CAMERA, CALIBRATION.pose_left_right)
        assert told.pose_base_camera == PoseData.of(Workcell().camera.pose_base_camera())
        stamps = []
        for _ in range(3):
            before = cameras.shown
            taken = camera.capture(1.0, 0)
            number = int(taken.left[0, 0])
            # later than what was shown by then; the numbers begin again after 200
            assert 0 < (number - before) % 200 < 100 and int(taken.right[0, 0]) == number + 1
            assert taken.left.shape == (6, 8) and taken.left_encoding == "mono8"
            stamps.append(taken.stamp_ns)
        assert sorted(stamps) == stamps and len(set(stamps)) == 3
        assert abs(stamps[-1] - time.monotonic_ns()) < 2_000_000_000
        # away and back
        cameras.away = True
        with pytest.raises(DeviceLost, match=f"no picture came on ({LEFT}|{RIGHT}).* within 2 s"):
            camera.capture(1.0, 0)
        cameras.away = False
        assert camera.capture(1.0, 0).stamp_ns > stamps[-1]


def test_cameras_that_are_not_triggered_together_are_named(endpoint: str) -> None:
    apart, why = opened(endpoint, lambda node: Cameras(node, apart_ns=9_000_000)), "within 5 ms: trigger both together"
    with apart as (camera, _), pytest.raises(DeviceLost, match=why):
        camera.capture(1.0, 0)
    with opened(endpoint, lambda node: Cameras(node, apart_ns=9_000_000), pair_within_s=0.0095) as (camera, _):
        taken = camera.capture(1.0, 0)
        assert int(taken.right[0, 0]) == int(taken.left[0, 0]) + 1


def test_the_right_camera_first_is_named(endpoint: str) -> None:
    swapped = {"left_info": "/camera/right/camera_info", "right_info": "/camera/left/camera_info"}
    with (
        pytest.raises(ConfigError, match=r"left_info, right_info: P says .* name the left"),
        opened(endpoint, **swapped),
    ):
        pass


def test_a_calibration_that_was_found_counts_in_place_of_the_camera_infos(endpoint: str, tmp_path: Path) -> None:
    found = CALIBRATION.model_copy(update={"left": CAMERA.model_copy(update={"fx_px": 5.25, "cx_px": 3.75})})
    file = tmp_path / "cameras.json"
    file.write_text(found.model_dump_json(), encoding="utf-8")
    silent = {"left_info": "/nobody/left", "right_info": "/nobody/right"}
    with opened(endpoint, calibration=str(file), **silent) as (camera, _):
        told = camera.calibration()
        assert (told.left, told.right, told.pose_base_camera) == (found.left, found.right, found.pose_base_camera)
        assert camera.capture(1.0, 0).left.shape == (6, 8)
    file.write_text("left: 3", encoding="utf-8")
    with (
        pytest.raises(ConfigError, match=r"hardware\.ros2\.camera\.calibration: .*cameras\.json: left: "),
        opened(endpoint, calibration=str(file)),
    ):
        pass
