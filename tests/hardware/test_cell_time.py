"""A sensor with this machine's stamps beside an arm that has a clock of its own."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from crosspih_common.arm import ArmModel
from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array
from services.hardware.cell_time import CellStampedWrench, TimedJoints
from services.hardware.protocols import JointReading, WrenchSamples

DRIFT = 1.0 + 40e-6


class Joints:
    """Its clock began long ago, and is slow."""

    def __init__(self, host_ns: Callable[[], int]) -> None:
        self.model: ArmModel = Workcell().arm()
        self.period_s, self._host_ns = 0.002, host_ns

    def read(self) -> JointReading:
        return JointReading(cell_ns(self._host_ns()), np.zeros(6), np.zeros(6))

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        """Nothing."""

    def halt(self) -> None:
        """Nothing."""


class Sensor:
    """A sample each millisecond of this machine's clock."""

    period_s = 0.001

    def __init__(self, host_ns: Callable[[], int]) -> None:
        self._host_ns = host_ns

    def read(self) -> WrenchSamples:
        now = self._host_ns()
        stamps = np.array([now - 1_000_000, now], dtype=np.int64)
        return WrenchSamples(stamps, np.zeros((2, 6)))


def cell_ns(host_ns: int) -> int:
    return 7_000_000_000_000 + round((host_ns - 10**15) / DRIFT)


def test_its_samples_are_put_on_the_arms_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [10**15]
    rng = np.random.default_rng(4)
    # the arm's answer is under way for a while before it is read
    monkeypatch.setattr(time, "monotonic_ns", lambda: now[0] + round(rng.exponential(2e5)) + 20_000)
    joints = TimedJoints(Joints(lambda: now[0]))
    wrench = CellStampedWrench(Sensor(lambda: now[0]), joints)
    last = -1
    for _ in range(4000):
        now[0] += 2_000_000
        joints.read()
        stamps = wrench.read().stamps_ns
        assert last < stamps[0] < stamps[1]
        last = int(stamps[1])
        if joints.clock.settled:
            off_s = abs(last - cell_ns(now[0])) * 1e-9
            assert off_s <= joints.clock.uncertainty_s + 2e-8
    assert joints.clock.uncertainty_s < 6e-4


def test_an_arm_that_makes_up_for_lost_time_hears_the_sensor_as_it_comes_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its cycles stood still for 200 ms, and follow each other at once until they are in time again."""
    host = [10**15]
    cell = [10**15]
    monkeypatch.setattr(time, "monotonic_ns", lambda: host[0])
    joints = TimedJoints(Joints(lambda: cell[0]))
    wrench = CellStampedWrench(Sensor(lambda: host[0]), joints)

    def cycle(host_step_ns: int) -> int:
        host[0] += host_step_ns
        cell[0] += 2_000_000
        joints.read()
        return len(wrench.read().stamps_ns)

    for _ in range(1000):
        assert cycle(2_000_000) == 2
    host[0] += 198_000_000
    sensor_says = [cycle(2_000_000), *(cycle(0) for _ in range(99))]
    # the last ones are handed on at the end, none before the cycles are near them
    assert sum(sensor_says[:90]) == 0 and sum(sensor_says) >= 2
