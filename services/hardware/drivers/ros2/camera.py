"""Two image topics as the cell's stereo camera."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError, DeviceLost
from crosspih_common.messages import CameraCalibration
from crosspih_common.messages.images import ENCODINGS, Pixels
from crosspih_common.ros2 import RosNode, RosQos, RosSample
from crosspih_common.ros2.stereo import CameraInfo, calibration_of
from services.hardware.drivers.calibration_file import read_calibration
from services.hardware.drivers.ros2.config import Ros2Config
from services.hardware.drivers.ros2.samples import RosTime, TopicSamples
from services.hardware.protocols import StereoCapture

FIELD = "hardware.ros2.camera"
IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
PICTURES = RosQos(reliable=False, depth=5)  # rclcpp::SensorDataQoS: what camera drivers offer suits it
KEEP = 6  # pictures a side
GENERIC = {"8UC1": "mono8", "16UC1": "mono16", "8UC3": "bgr8"}  # OpenCV's names, which cv_bridge writes


class RosCamera:
    """Implements CameraDevice: a capture is the first pair that was surely exposed after it was asked for."""

    def __init__(self, node: RosNode, config: Ros2Config, ros_time: RosTime, workcell: Workcell) -> None:
        """Raises ConfigError where a topic is silent, the camera_infos are no pair's or the file is no calibration."""
        self._config, self._time = config.camera, ros_time
        self.exposure_s = config.camera.exposure_s
        self._lock = threading.Lock()
        sides = (config.camera.left, "left"), (config.camera.right, "right")
        self._images = tuple(TopicSamples(node, name, IMAGE, f"{FIELD}.{side}", PICTURES, KEEP) for name, side in sides)
        file = config.camera.calibration
        if file is not None:
            self._calibration = read_calibration(file, f"{FIELD}.calibration", workcell)
        else:
            self._calibration = _told_calibration(node, config, workcell)

    def calibration(self) -> CameraCalibration:
        """Of the file, or from the camera_infos; where the left camera stands is then the cell's to say."""
        return self._calibration.model_copy(update={"stamp_ns": time.monotonic_ns()})

    def capture(self, exposure_scale: float, lamp: int) -> StereoCapture:
        """A pair. A topic has one exposure and one light, so both are ignored. Raises DeviceLost."""
        with self._lock:
            began_s = time.monotonic()
            for heard in self._images:
                heard.taken()
            lefts, rights = (dict[int, Any]() for _ in range(2))
            found: list[int] = []
            counts = [heard.count for heard in self._images]
            while len(found) <= self._config.skip_pairs:
                left_s = self._config.wait_s - (time.monotonic() - began_s)
                if left_s <= 0.0:
                    raise DeviceLost(self._silent(counts, len(found)))
                self._images[1 if len(lefts) > len(rights) else 0].wait_until(bool, min(left_s, 0.05))
                for heard, kept in zip(self._images, (lefts, rights), strict=True):
                    for sample in heard.taken():
                        message = heard.decode(sample)
                        kept[self._stamp(message, sample)] = message
                found = [stamp for stamp in sorted(lefts) if self._partner(stamp, rights) is not None]
            stamp = found[-1]
            partner = self._partner(stamp, rights)
            assert partner is not None
            left, right = lefts[stamp], rights[partner]
        pictures = [self._picture(message, side) for message, side in ((left, "left"), (right, "right"))]
        return StereoCapture(
            stamp, self.exposure_s, pictures[0][0], pictures[1][0], pictures[0][1], pictures[1][1]
        )  # fmt: skip

    def _stamp(self, message: Any, sample: RosSample) -> int:
        return self._time.stamp_ns(message, sample)

    def _partner(self, stamp: int, others: dict[int, Any]) -> int | None:
        nearest = min(others, key=lambda other: abs(other - stamp), default=None)
        if nearest is None or abs(nearest - stamp) > self._config.pair_within_s * 1e9:
            return None
        return nearest

    def _silent(self, counts: list[int], pairs: int) -> str:
        came = [heard.count - before for heard, before in zip(self._images, counts, strict=True)]
        names = [heard.name for heard in self._images]
        if pairs:
            return (
                f"{pairs} pairs came on {names[0]} and {names[1]} in {self._config.wait_s:g} s, and the first "
                f"{self._config.skip_pairs} may be from before they were asked for: a longer {FIELD}.wait_s, or a "
                "faster camera"
            )
        if all(came):
            return (
                f"{came[0]} and {came[1]} pictures came on {names[0]} and {names[1]} in {self._config.wait_s:g} s, and "
                f"too few belong together within {self._config.pair_within_s * 1e3:g} ms: trigger both together, or "
                f"widen {FIELD}.pair_within_s"
            )
        away = " and ".join(name for name, count in zip(names, came, strict=True) if not count)
        return f"no picture came on {away} within {self._config.wait_s:g} s"

    def _picture(self, message: Any, side: str) -> tuple[Pixels, str]:
        camera = self._calibration.left if side == "left" else self._calibration.right
        if (message.width, message.height) != (camera.width_px, camera.height_px):
            raise DeviceLost(
                f"the {side} picture is {message.width} x {message.height}, its camera_info says {camera.width_px} x "
                f"{camera.height_px}; calibrate at the size that is used"
            )
        try:
            return pixels_of(message)
        except ValueError as error:
            raise DeviceLost(f"the {side} picture: {error}") from None


def _told_calibration(node: RosNode, config: Ros2Config, workcell: Workcell) -> CameraCalibration:
    """What the two camera_infos say. Raises ConfigError."""
    names = (config.camera.left_info, "left_info"), (config.camera.right_info, "right_info")
    heard = [TopicSamples(node, name, INFO, f"{FIELD}.{side}", RosQos(transient_local=True, depth=1), 1)
             for name, side in names]  # fmt: skip
    infos = [camera_info(one.first(config.connect_s)) for one in heard]
    base = workcell.camera.pose_base_camera()
    try:
        return calibration_of(infos[0], infos[1], base, config.camera.rectified)
    except ValueError as error:
        raise ConfigError(f"{FIELD}.left_info, right_info: {error}") from None


def camera_info(message: Any) -> CameraInfo:
    """The numbers of a sensor_msgs/CameraInfo."""
    return CameraInfo(
        int(message.width), int(message.height), str(message.distortion_model), np.asarray(message.d, float),
        np.asarray(message.k, float).reshape(3, 3), np.asarray(message.r, float).reshape(3, 3),
        np.asarray(message.p, float).reshape(3, 4),
    )  # fmt: skip


def pixels_of(message: Any) -> tuple[Pixels, str]:
    """The pixels of a sensor_msgs/Image, (h, w) or (h, w, 3), and their encoding. ValueError where it is not ours."""
    encoding = GENERIC.get(message.encoding, message.encoding)
    kind, channels = ENCODINGS.get(encoding, ("u0", 0))
    if not channels:
        raise ValueError(f"encoding {message.encoding!r}; want one of {', '.join(ENCODINGS)}")
    depth = int(kind[-1])
    width, height, step = int(message.width), int(message.height), int(message.step)
    data = np.asarray(message.data, np.uint8)
    if step < width * channels * depth or len(data) < step * height:
        raise ValueError(f"{len(data)} bytes and rows of {step} are too few for {width} x {height} {encoding}")
    rows = data[: step * height].reshape(height, step)[:, : width * channels * depth]
    order = ">" if message.is_bigendian and depth == 2 else "<"
    pixels = np.ascontiguousarray(rows).view(f"{order}u{depth}" if depth == 2 else "u1")
    native = pixels.astype(f"u{depth}", copy=False).reshape((height, width, 3) if channels == 3 else (height, width))
    return native, encoding
