"""The simulated cell with its sensor behind a real protocol: what it feels is fed to a peer that speaks it, ATI's Net
F/T or Robotiq's FT 300, and comes back through the driver `ati` or `robotiq`, as from the sensor on a bench.

    python -m services.operator.bench.protocols.ati --stay &
    CROSSPIH_CELL=docs/examples/sensor-behind-ati.yaml crosspih assemble
"""

from __future__ import annotations

import contextlib
import dataclasses
import socket
import struct
import time

from crosspih_common.arm import ArmModel
from crosspih_common.errors import ConfigError
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.simulated.cell import open_devices as open_simulated
from services.hardware.protocols import Devices, JointDevice, JointReading, WrenchDevice

AHEAD_S, BEHIND_S = 0.002, 0.05  # of the wall's time
WRENCH = struct.Struct("<6d")  # Fx Fy Fz, N, Tx Ty Tz, Nm: what the peer takes


class FeedingJoints:
    """Implements JointDevice: the simulated joints, which send on what the simulated sensor felt in each cycle.

    They keep to the wall's time and, kept waiting for long, do not make up for it: the box samples by a clock that
    waits for nobody, and a world that rushed through half a second would have been felt at some instants of it only.
    """

    def __init__(self, joints: JointDevice, wrench: WrenchDevice, host: str, port: int) -> None:
        self._joints, self._wrench = joints, wrench
        self._feed = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._feed.connect((host, port))
        self.model: ArmModel = joints.model
        self.period_s = joints.period_s
        self._due_s = time.monotonic()

    def read(self) -> JointReading:
        """The next cycle, and what was felt until then on its way."""
        now_s = time.monotonic()
        self._due_s = max(self._due_s + self.period_s, now_s - BEHIND_S)
        if self._due_s - now_s > AHEAD_S:
            time.sleep(self._due_s - now_s)
        reading = self._joints.read()
        for wrench in self._wrench.read().wrenches:
            with contextlib.suppress(ConnectionRefusedError):  # nobody is there to feel it
                self._feed.send(WRENCH.pack(*wrench))
        return reading

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        """The reference of the next cycle."""
        self._joints.write(positions_rad, speeds_rad_s)

    def halt(self) -> None:
        """Stay."""
        self._joints.halt()

    def close(self) -> None:
        """Feed no more."""
        self._feed.close()


def open_devices(request: OpenRequest) -> Devices:
    """The simulated arm and cameras; the sensor is another driver's. Raises ConfigError: options.feed is no address,
    and a cell without a time of its own."""
    if not request.realtime:
        raise ConfigError("hardware.driver: a sensor behind a protocol needs real time: --speed realtime")
    where = str(request.options.get("feed", "127.0.0.1:49160"))
    host, _, port = where.rpartition(":")
    if not host or not port.isdigit():
        raise ConfigError(f"hardware.options.feed: {where!r}, want an address and a port: 127.0.0.1:49160")
    devices = open_simulated(dataclasses.replace(request, realtime=False))
    assert devices.joints is not None and devices.wrench is not None
    joints = FeedingJoints(devices.joints, devices.wrench, host, int(port))

    def close() -> None:
        joints.close()
        devices.close()

    return dataclasses.replace(devices, joints=joints, wrench=None, realtime=True, close=close)
