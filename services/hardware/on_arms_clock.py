"""A sensor that stamps by this machine's clock, put on the cell's: the joints' own, which every reading of them
tells."""

from __future__ import annotations

import time

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.geometry.pose import Array
from services.hardware.device_clock import DeviceClock, onward
from services.hardware.protocols import JointDevice, JointReading, WrenchDevice, WrenchSamples

AHEAD_NS = 10_000_000  # of the last cycle: as much as any arm that is in time is behind its own clock


class TimedJoints:
    """Implements JointDevice: another one, whose readings also tell when the cell's clock was at their stamps here."""

    def __init__(self, joints: JointDevice) -> None:
        self._joints = joints
        self.clock = DeviceClock()
        self.now_ns = 0
        self.start_ns: int | None = None  # of the first reading: the cell has no time before

    @property
    def model(self) -> ArmModel:
        """The arm's."""
        return self._joints.model

    @property
    def period_s(self) -> float:
        """The arm's."""
        return self._joints.period_s

    def read(self) -> JointReading:
        """The next cycle."""
        reading = self._joints.read()
        self.clock.observe(reading.stamp_ns * 1e-9, time.monotonic_ns())
        self.now_ns = reading.stamp_ns
        if self.start_ns is None:
            self.start_ns = reading.stamp_ns
        return reading

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        """The reference of the next cycle."""
        self._joints.write(positions_rad, speeds_rad_s)

    def halt(self) -> None:
        """Stop as the arm can."""
        self._joints.halt()


class CellStampedWrench:
    """Implements WrenchDevice: another one that stamps with `time.monotonic_ns()`, on the cell's clock.

    A simulated arm that is kept waiting falls behind the clock that it had before; what is heard in a cycle is said to
    be no more than 10 ms later than that.
    """

    def __init__(self, wrench: WrenchDevice, joints: TimedJoints) -> None:
        self._wrench, self._joints = wrench, joints
        self._last_ns: int | None = None

    @property
    def period_s(self) -> float:
        """The sensor's."""
        return self._wrench.period_s

    def read(self) -> WrenchSamples:
        """The samples since the last read, and since the cell's time began. A better estimate of the clock never puts
        one before that which it follows."""
        samples, joints = self._wrench.read(), self._joints
        if not len(samples.stamps_ns):
            return samples
        stamps = np.rint(joints.clock.many_to_device_s(samples.stamps_ns) * 1e9).astype(np.int64)
        within = stamps >= (joints.start_ns or 0)
        stamps, wrenches = stamps[within], samples.wrenches[within]
        if len(stamps):
            stamps = onward(np.minimum(stamps, joints.now_ns + AHEAD_NS), self._last_ns)
            self._last_ns = int(stamps[-1])
        return WrenchSamples(stamps, wrenches)
