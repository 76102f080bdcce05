"""The cameras of picture files: what is wrong with a file is said when the service starts, not at the first capture."""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np

from crosspih_common.errors import ConfigError
from crosspih_common.messages import CameraCalibration
from crosspih_common.messages.images import Pixels
from services.hardware.drivers.calibration_file import read_calibration
from services.hardware.drivers.registry import OpenRequest
from services.hardware.protocols import Devices, StereoCapture

FIELD = "hardware.pictures"


class PictureCamera:
    """Implements CameraDevice: each capture gives the next pair, and the last one over again."""

    def __init__(self, pairs: list[tuple[Pixels, Pixels]], calibration: CameraCalibration, exposure_s: float) -> None:
        self._pairs, self._calibration = pairs, calibration
        self.exposure_s = exposure_s
        self._next = 0
        self._lock = threading.Lock()

    def calibration(self) -> CameraCalibration:
        """As the file says it."""
        return self._calibration

    def capture(self, exposure_scale: float, lamp: int) -> StereoCapture:
        """The next pair: a file has one exposure and one light, so both are ignored."""
        with self._lock:
            left, right = self._pairs[min(self._next, len(self._pairs) - 1)]
            self._next += 1
        return StereoCapture(-1, self.exposure_s, left, right, host_ns=time.monotonic_ns())


def open_devices(request: OpenRequest) -> Devices:
    """The cameras of `hardware.pictures`. Raises ConfigError naming the field and the file."""
    config = request.config.pictures
    if others := sorted(request.wanted - {"camera"}):
        raise ConfigError(
            f"hardware.driver: pictures opens no {others[0]}; name it for the cameras alone: "
            "drivers: {camera: pictures}"
        )
    if not config.left or len(config.left) != len(config.right):
        raise ConfigError(
            f"{FIELD}.left, right: {len(config.left)} and {len(config.right)} files, want as many of both, one or more"
        )
    calibration = read_calibration(config.calibration, f"{FIELD}.calibration", request.workcell)
    pairs = []
    for left, right in zip(config.left, config.right, strict=True):
        pair = _picture(left, "left", calibration), _picture(right, "right", calibration)
        pairs.append(pair)
    print(f"cameras: {len(pairs)} pairs of picture files, {config.left[0]} first", file=sys.stderr, flush=True)
    return Devices(camera=PictureCamera(pairs, calibration, config.exposure_s), realtime=request.realtime)


def _picture(path: Path, side: str, calibration: CameraCalibration) -> Pixels:
    read = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if read is None:
        raise ConfigError(f"{FIELD}.{side}: {path} is no picture that can be read")
    if read.ndim == 3:
        read = cv2.cvtColor(read, cv2.COLOR_BGRA2RGB if read.shape[2] == 4 else cv2.COLOR_BGR2RGB)
    if read.dtype not in (np.uint8, np.uint16):
        raise ConfigError(f"{FIELD}.{side}: {path} holds {read.dtype}, want 8 or 16 bits a channel")
    camera = calibration.left if side == "left" else calibration.right
    if read.shape[:2] != (camera.height_px, camera.width_px):
        raise ConfigError(
            f"{FIELD}.{side}: {path} is {read.shape[1]} x {read.shape[0]}, the calibration says "
            f"{camera.width_px} x {camera.height_px}"
        )
    return np.asarray(read, dtype=read.dtype.type)
