"""`python -m services.hardware.peers.following`: simulated cameras whose arm is moved by another process, and before
which a ChArUco board is held; on the bus as a cell's cameras are. What they see is told by UDP at
`hardware.options.follow_port` of 127.0.0.1: six and more doubles are where the arm's joints stand, rad; a word is where
the board is, and is answered by itself: `away`, `flange` (clamped there, as `hardware.simulated.board` says), `hand` (a
person holds it: each picture shows the next pose of `hardware.options.held`, [position_m, rotvec_rad] in the base).
"""

from __future__ import annotations

import contextlib
import socket
import sys
import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np

from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration
from crosspih_common.service import ServiceContext, run_service
from services.hardware.__main__ import build
from services.hardware.config import DriversConfig, HardwareConfig
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.simulated import cell
from services.hardware.drivers.simulated.scene.stereo import SimulatedStereoCamera
from services.hardware.protocols import Devices, StereoCapture
from services.hardware.shells.hardware import HardwareShell

WHERE = ("away", "flange", "hand")


class FollowingCamera:
    """Implements the CameraDevice protocol."""

    def __init__(self, camera: SimulatedStereoCamera, port: int, held: list[Pose]) -> None:
        self._camera, self._held = camera, held
        self._where, self._shown = "away", 0
        self.exposure_s = camera.exposure_s
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        threading.Thread(target=self._hear, name="following", daemon=True).start()

    def _hear(self) -> None:
        with contextlib.suppress(OSError):  # closed
            while True:
                data, sender = self._socket.recvfrom(4096)
                self._take(data, sender)

    def _take(self, data: bytes, sender: Any) -> None:
        word = data.decode("ascii", "replace")
        if word in WHERE:
            self._where = word
            self._socket.sendto(data, sender)
        elif len(data) % 8 == 0:
            self._camera.arm_stands_at(np.frombuffer(data, dtype="<f8").copy())

    def calibration(self) -> CameraCalibration:
        """As the simulated cameras tell it."""
        return self._camera.calibration()

    def capture(self, exposure_scale: float, lamp: int) -> StereoCapture:
        """What is seen now, the board where it is."""
        if self._where == "hand" and self._held:
            self._camera.board_at(self._held[self._shown % len(self._held)])
            self._shown += 1
        else:
            self._camera.board_at(None, there=self._where == "flange")
        taken = self._camera.capture(exposure_scale, lamp)
        # the cell's clock does not run without an arm, and each picture needs a stamp of its own
        return replace(taken, stamp_ns=time.monotonic_ns())

    def close(self) -> None:
        """Hear no more."""
        self._socket.close()


def open_devices(request: OpenRequest) -> Devices:
    """The cameras alone. Raises ConfigError for options that are not there."""
    port, held = request.options.get("follow_port"), request.options.get("held") or []
    if not isinstance(port, int):
        raise ConfigError("hardware.options.follow_port: name the UDP port at which the joints are told")
    devices = cell.open_devices(request)
    assert isinstance(devices.camera, SimulatedStereoCamera)
    camera = FollowingCamera(devices.camera, port, [Pose.from_rotvec(turn, place) for place, turn in held])

    def close() -> None:
        camera.close()
        devices.close()

    return Devices(camera=camera, realtime=request.realtime, close=close)


def main() -> int:
    """Run the cell's cameras, whatever driver its file names for them."""

    def built(context: ServiceContext, config: HardwareConfig) -> HardwareShell:
        drivers = DriversConfig(camera="services.hardware.peers.following:open_devices")
        return build(context, config.model_copy(update={"drivers": drivers}), frozenset({"camera"}))

    return run_service("camera", HardwareConfig, built, sys.argv[1:], section="hardware")


if __name__ == "__main__":
    sys.exit(main())
