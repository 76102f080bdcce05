"""A driver of an arm that speaks lines of text over TCP, with its wrist sensor: docs/own-hardware.md, followed.

The controller says "LINES 1 JOINTS PERIOD_US" once, then each cycle "S TIME_US POSITIONS SPEEDS WRENCH"; it is told
"P POSITIONS SPEEDS" and "H", halt. `hardware.driver: docs.examples.line_arm:open_devices`, `options: {host, port}`;
`python -m docs.examples.line_peer` is a controller to try it with (docs/examples/line-arm.yaml).
"""

from __future__ import annotations

import socket
import time
from contextlib import suppress

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.errors import ConfigError, DeviceLost
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.registry import OpenRequest
from services.hardware.protocols import Devices, JointReading, WrenchSamples

ANSWER_S = 0.5  # a cycle takes milliseconds: who says nothing for so long is away
RETRY_S = 0.1


class LineArm:
    """Implements JointDevice. Away, it is looked for again at each read."""

    def __init__(self, model: ArmModel, host: str, port: int) -> None:
        self.model, self._address = model, (host, port)
        self.samples: list[tuple[int, Array]] = []
        self._connect()

    def _connect(self) -> None:
        self._socket = socket.create_connection(self._address, ANSWER_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._lines = self._socket.makefile("r", encoding="ascii")
        words = self._lines.readline().split()
        if len(words) != 4 or words[:2] != ["LINES", "1"]:
            self.close()
            raise ConfigError(f"hardware.options.host: {self._address[0]} says {' '.join(words)!r}, want LINES 1 ...")
        if int(words[2]) != self.model.joints:
            self.close()
            raise ConfigError(f"cell.arm has {self.model.joints} joints, the controller {words[2]}: name the right arm")
        self.period_s = int(words[3]) * 1e-6

    def read(self) -> JointReading:
        """The next line; DeviceLost while there is none."""
        try:
            if self._socket.fileno() < 0:
                self._connect()
            words = self._lines.readline().split()
            if not words or words[0] != "S":
                raise ConnectionError("it closed the connection, or says what is no state")
            stamp_ns, values = int(words[1]) * 1000, np.array([float(word) for word in words[2:]])
        except (OSError, ValueError) as error:
            self.close()
            time.sleep(RETRY_S)  # the loop asks again at once
            text = f"the arm at {self._address[0]} is away ({error}); switch it on, mind its cable"
            raise DeviceLost(text) from None
        joints = self.model.joints
        self.samples.append((stamp_ns, values[2 * joints :]))
        return JointReading(stamp_ns, values[:joints], values[joints : 2 * joints])

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        """Where to be in the next cycle."""
        self._say("P " + " ".join(f"{value:.9f}" for value in (*positions_rad, *speeds_rad_s)))

    def halt(self) -> None:
        """Stand still."""
        self._say("H")

    def _say(self, line: str) -> None:
        with suppress(OSError):  # the next read tells that it is away
            self._socket.sendall(f"{line}\n".encode("ascii"))

    def close(self) -> None:
        """Hang up."""
        self._lines.close()
        self._socket.close()


class LineSensor:
    """Implements WrenchDevice: what came with the arm's own lines."""

    def __init__(self, arm: LineArm) -> None:
        self._arm, self.period_s = arm, arm.period_s

    def read(self) -> WrenchSamples:
        """The samples since the last read."""
        samples, self._arm.samples = self._arm.samples, []
        stamps = np.array([stamp for stamp, _ in samples], dtype=np.int64)
        return WrenchSamples(stamps, np.array([wrench for _, wrench in samples]).reshape(-1, 6))


def open_devices(request: OpenRequest) -> Devices:
    """The arm at `hardware.options.host` and `port`."""
    host, port = request.options.get("host", "127.0.0.1"), int(request.options.get("port", 5757))
    try:
        arm = LineArm(request.workcell.arm(), host, port)
    except OSError as error:
        raise ConfigError(f"hardware.options.host: nobody answers at {host}:{port} ({error}); is it on?") from None
    return Devices(joints=arm, wrench=LineSensor(arm), close=arm.close)


open_devices.opens = ("arm", "force_torque")  # type: ignore[attr-defined]  # for `crosspih cell drivers`
