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
        return reading

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        """The reference of the next cycle."""
        self._joints.write(positions_rad, speeds_rad_s)

    def halt(self) -> None:
        """Stop as the arm can."""
        self._joints.halt()


class CellStampedWrench:
    """Implements WrenchDevice: another one that stamps with `time.monotonic_ns()`, on the cell's clock.

    A simulated arm that was kept waiting makes up for it by cycles that follow each other faster than time goes by.
    What the sensor said meanwhile lies ahead of them, and is handed on as they come to it: else the first would hear
    all of it, and the others a sensor that is silent.
    """

    def __init__(self, wrench: WrenchDevice, joints: TimedJoints) -> None:
        self._wrench, self._joints = wrench, joints
        self._handed_ns: int | None = None
        self._kept = WrenchSamples(np.zeros(0, dtype=np.int64), np.zeros((0, 6)))
        self._restarts = 0

    @property
    def period_s(self) -> float:
        """The sensor's."""
        return self._wrench.period_s

    def read(self) -> WrenchSamples:
        """The samples since the last read that are due. A better estimate of the clock never puts one before that which
        it follows."""
        samples, clock = self._wrench.read(), self._joints.clock
        if len(samples.stamps_ns):
            stamps = np.rint(clock.many_to_device_s(samples.stamps_ns) * 1e9).astype(np.int64)
            samples = WrenchSamples(stamps, samples.wrenches)
        kept = self._kept
        if len(kept.stamps_ns):
            samples = WrenchSamples(
                np.concatenate((kept.stamps_ns, samples.stamps_ns)), np.concatenate((kept.wrenches, samples.wrenches))
            )
        if not len(samples.stamps_ns):
            return samples
        latest_ns = self._joints.now_ns + AHEAD_NS
        due = len(samples.stamps_ns)
        if clock.restarts == self._restarts and samples.stamps_ns[-1] > latest_ns:
            due = int(np.searchsorted(samples.stamps_ns, latest_ns, side="right"))
        self._restarts = clock.restarts
        self._kept = WrenchSamples(samples.stamps_ns[due:], samples.wrenches[due:])
        if not due:
            return WrenchSamples(samples.stamps_ns[:0], samples.wrenches[:0])
        handed = onward(np.minimum(samples.stamps_ns[:due], latest_ns), self._handed_ns)
        self._handed_ns = int(handed[-1])
        return WrenchSamples(handed, samples.wrenches[:due])
