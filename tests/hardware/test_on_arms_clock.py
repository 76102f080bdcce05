"""A sensor with this machine's stamps beside an arm that has a clock of its own."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from crosspih_common.arm import ArmModel
from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array
from services.hardware.on_arms_clock import CellStampedWrench, TimedJoints
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
        stamps = wrench.read().stamps_ns.tolist()
        if last < 0:  # the cell's time has just begun
            last = max(stamps, default=-1)
            continue
        assert last < stamps[0] < stamps[1]
        last = stamps[1]
        if joints.clock.settled:
            off_s = abs(last - cell_ns(now[0])) * 1e-9
            assert off_s <= joints.clock.uncertainty_s + 2e-8
    assert joints.clock.uncertainty_s < 6e-4


class Sampled(Sensor):
    """Samples by the millisecond, each once."""

    def __init__(self, host_ns: Callable[[], int]) -> None:
        super().__init__(host_ns)
        self._next_ns = host_ns()

    def read(self) -> WrenchSamples:
        stamps = np.arange(self._next_ns, self._host_ns() + 1, 1_000_000, dtype=np.int64)
        self._next_ns += 1_000_000 * len(stamps)
        return WrenchSamples(stamps, np.zeros((len(stamps), 6)))


def test_an_arm_that_falls_behind_hears_nothing_of_the_future(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its clock goes half as fast as ours for a while, and as fast again then."""
    host = [10**15]
    cell = [10**15]
    monkeypatch.setattr(time, "monotonic_ns", lambda: host[0])
    joints = TimedJoints(Joints(lambda: cell[0]))
    wrench = CellStampedWrench(Sampled(lambda: host[0]), joints)
    last, count = -1, 0
    for cycle in range(9000):
        host[0] += 4_000_000 if 2000 < cycle < 4000 else 2_000_000
        cell[0] += 2_000_000
        now_ns = joints.read().stamp_ns
        stamps = wrench.read().stamps_ns.tolist()
        if cycle:
            assert last < stamps[0] and stamps[-1] <= now_ns + 11_000_000
        last, count = max(stamps, default=last), count + len(stamps)
    assert abs(last - now_ns) < 1_000_000
    assert count == pytest.approx(2 * 9000 + 2 * 1999, abs=4)  # none is lost but of before the beginning


def test_what_was_sampled_before_the_cells_time_began_is_not_handed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    host = [10**15]
    monkeypatch.setattr(time, "monotonic_ns", lambda: host[0])
    late = Sampled(lambda: host[0] - 1_500_000_000)  # what it says has been under way for so long
    joints = TimedJoints(Joints(lambda: host[0]))
    wrench = CellStampedWrench(late, joints)
    heard: list[int] = []
    for _ in range(1000):
        host[0] += 2_000_000
        joints.read()
        heard += wrench.read().stamps_ns.tolist()
    assert heard and min(heard) >= (joints.start_ns or 0) and len(heard) == pytest.approx(500, abs=3)
