"""The arm and its wrist sensor as devices, over one connection that is made anew whenever it is lost.

Nothing moves by itself afterwards: the new connection only listens, until somebody writes a set-point; the robot's
program is started then, holding the arm where it stands, and refuses a first set-point that is elsewhere.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import time

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.errors import ConfigError, DeviceLost
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.ur.config import UrConfig
from services.hardware.drivers.ur.link import Expected, Package, UrLink
from services.hardware.drivers.ur.readings import raw_reading
from services.hardware.drivers.ur.stamps import Stamps
from services.hardware.protocols import JointReading, WrenchSamples

AGAIN_S = 0.25  # between two attempts to connect
_POLL_S = 0.02  # how long a read waits for a connection that is away
KEPT = 1000  # samples that nobody has read yet


class UrArm:
    """Implements JointDevice. Made connected: raises ConfigError, DeviceLost."""

    def __init__(self, config: UrConfig, expected: Expected, gravity_base_m_s2: Array) -> None:
        self._config, self._expected, self._gravity = config, expected, gravity_base_m_s2
        self._link: UrLink | None = UrLink(config, expected)
        self.period_s = self._link.period_s
        self.stamps = Stamps()
        self._version = self._link.version
        self._samples: list[tuple[int, Array]] = []
        self._stood_rad = np.asarray(self._link.first["actual_q"], float)
        self._why = ""
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._again: threading.Thread | None = None
        self._say(
            f"{config.host}: {self._link.robot_model}, PolyScope {self._version[0]}.{self._version[1]}, "
            f"{1.0 / self.period_s:.0f} Hz, {self._link.note}"
        )

    @property
    def model(self) -> ArmModel:
        """The arm of the cell's file, compared with the controller's."""
        return self._expected.model

    def read(self) -> JointReading:
        """The next package's encoders. Raises DeviceLost while the robot is away or may not move, with the reason."""
        link = self._present()
        try:
            packages = link.receive()
        except DeviceLost as error:
            self._lose(str(error.text))
            raise
        self.stamps.observe(packages[-1]["timestamp"], time.monotonic_ns())
        return self._reading(packages)

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        """Where the joints (6,) are to be next. While the robot is away nothing is sent; `read` says so."""
        link = self._link
        if link is None:
            return
        positions = np.asarray(positions_rad, float)
        try:
            if not link.follows:
                off_rad = float(np.max(np.abs(positions - self._stood_rad)))
                if not off_rad <= self._config.start_tolerance_rad:
                    raise DeviceLost(
                        f"{self._config.host}: the first set-point is {off_rad:.4f} rad from where a joint stands, "
                        f"{self._config.start_tolerance_rad:g} is allowed (hardware.ur.start_tolerance_rad): not sent"
                    )
                link.start_program()
            link.follow(positions)
        except DeviceLost as error:
            self._lose(str(error.text))
            raise

    def halt(self) -> None:
        """The robot's program stops the arm and ends."""
        link = self._link
        if link is not None:
            with contextlib.suppress(DeviceLost):
                link.halt()

    def close(self) -> None:
        """Let the arm stand, and go."""
        self._closing.set()
        with self._changed:
            link, self._link = self._link, None
        if link is not None:
            link.close()
        if self._again is not None:
            self._again.join()

    def samples(self) -> WrenchSamples:
        """The wrist sensor's readings that came with the packages since the last call."""
        found, self._samples = self._samples, []
        if not found:
            return WrenchSamples(np.zeros(0, dtype=np.int64), np.zeros((0, 6)))
        return WrenchSamples(np.array([stamp for stamp, _ in found], np.int64), np.array([raw for _, raw in found]))

    # -------------------------------------------------------------------------------------------------------- packages

    def _reading(self, packages: list[Package]) -> JointReading:
        stamp_ns = 0
        for package in packages:
            stamp_ns = self.stamps.to_ns(package["timestamp"])
            if self._expected.wrench and len(self._samples) < KEPT:
                raw = raw_reading(self._config.wrench, package, self.model, self._version[0], self._gravity)
                self._samples.append((stamp_ns, raw))
        last = packages[-1]
        self._stood_rad = np.array(last["actual_q"])
        return JointReading(stamp_ns, self._stood_rad, np.array(last["actual_qd"]))

    # ------------------------------------------------------------------------------------------------- away, and back

    def _present(self) -> UrLink:
        with self._changed:
            if self._link is None:
                self._changed.wait(_POLL_S)
            if self._link is None:
                raise DeviceLost(f"{self._why}; it is asked again four times a second")
            return self._link

    def _lose(self, why: str) -> None:
        with self._changed:
            link, self._link = self._link, None
            self._why = why
            self._samples = []
        if link is not None:
            link.close()
            self._say(f"lost: {why}")
        if not self._closing.is_set() and (self._again is None or not self._again.is_alive()):
            self._again = threading.Thread(target=self._connect_again, name="ur-again", daemon=True)
            self._again.start()

    def _connect_again(self) -> None:
        while not self._closing.wait(AGAIN_S):
            try:
                link = UrLink(self._config, self._expected)
                if link.period_s != self.period_s:
                    link.close()
                    raise ConfigError("another series of robot answers than before; start the hardware service anew")
            except DeviceLost as error:
                why = error.text
            except ConfigError as error:
                why = str(error)
            else:
                with self._changed:
                    if not self._closing.is_set():
                        self._stood_rad = np.asarray(link.first["actual_q"], float)
                        self._link = link
                        self._changed.notify_all()
                        self._say(f"{self._config.host}: back; it stands until it is told to move")
                        return
                link.close()
                return
            if why != self._why:
                self._say(f"not back: {why}")
            self._why = why

    def _say(self, text: str) -> None:
        print(f"ur: {text}", file=sys.stderr, flush=True)


class UrWrench:
    """Implements WrenchDevice: the sensor in the wrist of the arm that reads it."""

    def __init__(self, arm: UrArm) -> None:
        self._arm, self.period_s = arm, arm.period_s

    def read(self) -> WrenchSamples:
        """The samples since the last read."""
        return self._arm.samples()
