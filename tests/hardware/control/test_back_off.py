"""The arm's way back after a cap: loads that are made up along a way that the arm really went."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.messages import ResetCell
from services.hardware.config import HardwareConfig
from services.hardware.control.backing_off import back_off
from services.hardware.control.cycle import CycleReading, Reference
from services.hardware.control.runner import Runner
from services.hardware.control.trail import TRAIL_STEP_RAD
from services.hardware.drivers.registry import open_devices
from services.hardware.protocols import Devices

STEPS = 400
SMALL, WORSE = (5.0, 0.5), (15.0, 1.5)
WORKCELL = Workcell()
HOME = np.asarray(WORKCELL.home_joints_rad)


@pytest.fixture(scope="module")
def devices() -> Iterator[Devices]:
    opened = open_devices(WORKCELL, HardwareConfig(), frozenset({"arm", "force_torque"}), realtime=False)
    yield opened
    opened.close()


@pytest.fixture
def runner(devices: Devices) -> Runner:
    """At the end of a way of STEPS along the first joint."""
    assert devices.joints is not None and devices.wrench is not None and devices.simulation is not None
    devices.simulation.reset(ResetCell(seed=0))
    made = Runner(devices.joints, devices.wrench, WORKCELL.pose_flange_peg(), WORKCELL.sensor_mounting())
    for step in range(1, STEPS + 1):
        made.advance(Reference(HOME + step * TRAIL_STEP_RAD * np.eye(6)[0], np.zeros(6)))
    return made


def along(runner: Runner) -> float:
    """How far along its way it is, 0 to 1."""
    return float(runner.joints_rad[0] - HOME[0]) / (STEPS * TRAIL_STEP_RAD)


def backed_off(runner: Runner, force_n: Callable[[float], float]) -> tuple[float, float]:
    """Where it stands after backing off, and the largest force on the way."""
    steps = back_off(runner, SMALL, WORSE)
    reference, largest = next(steps), 0.0
    while True:
        runner.advance(reference)
        force = force_n(along(runner))
        largest = max(largest, force)
        try:
            reference = steps.send(CycleReading(np.zeros((1, 6)), np.zeros(6), (0.0,) * 6, force, 0.0, HOME))
        except StopIteration:
            return along(runner), largest


def test_it_ends_where_little_is_felt(runner: Runner) -> None:
    where, largest = backed_off(runner, lambda at: 60.0 * max(0.0, (at - 0.5) / 0.5))
    assert 0.4 < where < 0.55 and largest <= 60.1


def test_it_stands_where_going_on_would_press_harder(runner: Runner) -> None:
    """Held on both sides of the middle, as a wedged peg is: 30 N at least, and back there."""
    where, largest = backed_off(runner, lambda at: 30.0 + 120.0 * abs(at - 0.5))
    # the filter of ten milliseconds sees the least a little later
    assert where == pytest.approx(0.5, abs=0.06)
    assert largest <= 90.1
    assert runner.trail.newest == pytest.approx(runner.joints_rad)


def test_held_all_along_it_ends_where_the_way_began(runner: Runner) -> None:
    where, _ = backed_off(runner, lambda at: 40.0 + at)
    assert where == pytest.approx(0.0, abs=1e-9)
