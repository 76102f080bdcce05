"""The arm's way back after a cap: loads that are made up along a way that the servo really went."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from crosspih_common.config import Workcell
from services.hardware.control.motions import back_off
from services.hardware.control.servo import TRAIL_STEP_RAD, Reading, Reference, Servo
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.engines.pybullet.engine import Physics
from services.hardware.drivers.simulated.sensor import SensorModel

STEPS = 400
SMALL, WORSE = (5.0, 0.5), (15.0, 1.5)
WORKCELL = Workcell()
HOME = np.asarray(WORKCELL.home_joints_rad)


@pytest.fixture(scope="module")
def physics() -> Iterator[Physics]:
    made = Physics(WORKCELL, SimulatedConfig())
    made.build(WORKCELL.hole_prior.pose_base_hole(), HOME)
    yield made
    made.close()


@pytest.fixture
def servo(physics: Physics) -> Servo:
    """At the end of a way of STEPS along the first joint."""
    made = Servo(WORKCELL, physics, SensorModel(SimulatedConfig().force_torque))
    made.restart(HOME, np.random.default_rng(0))
    for step in range(1, STEPS + 1):
        made.advance(Reference(HOME + step * TRAIL_STEP_RAD * np.eye(6)[0], np.zeros(6), np.zeros(6)))
    return made


def along(servo: Servo) -> float:
    """How far along its way it is, 0 to 1."""
    return float(servo.joints_rad[0] - HOME[0]) / (STEPS * TRAIL_STEP_RAD)


def backed_off(servo: Servo, force_n: Callable[[float], float]) -> tuple[float, float]:
    """Where it stands after backing off, and the largest force on the way."""
    steps = back_off(servo, SMALL, WORSE)
    reference, largest = next(steps), 0.0
    while True:
        servo.advance(reference)
        force = force_n(along(servo))
        largest = max(largest, force)
        try:
            reference = steps.send(Reading(np.zeros(6), np.zeros(6), force, 0.0))
        except StopIteration:
            return along(servo), largest


def test_it_ends_where_little_is_felt(servo: Servo) -> None:
    where, largest = backed_off(servo, lambda at: 60.0 * max(0.0, (at - 0.5) / 0.5))
    assert 0.4 < where < 0.55 and largest <= 60.1


def test_it_stands_where_going_on_would_press_harder(servo: Servo) -> None:
    """Held on both sides of the middle, as a wedged peg is: 30 N at least, and back there."""
    where, largest = backed_off(servo, lambda at: 30.0 + 120.0 * abs(at - 0.5))
    # the filter of ten milliseconds sees the least a little later
    assert where == pytest.approx(0.5, abs=0.06)
    assert largest <= 90.1
    assert servo.trail[-1] == pytest.approx(servo.joints_rad)


def test_held_all_along_it_ends_where_the_way_began(servo: Servo) -> None:
    where, _ = backed_off(servo, lambda at: 40.0 + at)
    assert where == pytest.approx(0.0, abs=1e-9)
