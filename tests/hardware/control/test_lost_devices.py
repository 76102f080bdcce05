"""An arm that is lost and comes back elsewhere, and one whose commands take long to judge: the control layer's part."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.errors import STOPPING, CommandRefused, DeviceLost
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Dwell, FollowTrajectory, JointKnot
from docs.examples.spring_wall import PERIOD_S, Joints, WallSensor
from services.hardware.control.arm import ArmController
from services.hardware.control.config import STRICT_LANDING, LimitsConfig
from services.hardware.protocols import JointReading

DEADLINE_S = 20.0
BASE = np.eye(6)[0]  # a turn about the base stays as far from the wall


class Losable(Joints):
    """The example's joints; `away` is the reason for which they do not answer."""

    away = ""
    breaks = False
    halted = 0
    told: Array | None = None
    cycles = 0

    def read(self) -> JointReading:
        self.cycles += 1
        if self.breaks:
            raise ZeroDivisionError("a driver's own fault")
        if self.away:
            time.sleep(PERIOD_S)
            raise DeviceLost(self.away)
        return super().read()

    def halt(self) -> None:
        self.halted += 1

    def was_told(self) -> Array | None:
        return self.told

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        if not self.away:
            self.told = positions_rad
            super().write(positions_rad, speeds_rad_s)


def arm_of(realtime: bool) -> tuple[ArmController, Losable]:
    workcell = Workcell()
    joints = Losable(workcell.arm(), np.asarray(workcell.home_joints_rad, float), wait=realtime)
    sensor = WallSensor(joints, workcell.pose_flange_peg(), workcell.peg.shape().tip_m, {})
    limits = LimitsConfig(missed_cycles=10000, holder_timeout_s=5.0)
    arm = ArmController(workcell, limits, STRICT_LANDING, joints, sensor, realtime)
    return arm, joints


def turned(arm: ArmController, by_rad: float) -> FollowTrajectory:
    here = np.asarray(arm.joint_state().joints_rad)
    still = (0.0,) * len(here)
    knots = [
        JointKnot(time_s=time_s, joints_rad=tuple(joints), speeds_rad_s=still, accelerations_rad_s2=still)
        for time_s, joints in ((0.0, here), (2.0, here + by_rad * BASE))
    ]
    return FollowTrajectory(knots=tuple(knots))


def test_a_lost_arm_is_not_sent_back_to_where_it_was() -> None:
    arm, joints = arm_of(realtime=False)
    assert arm.dwell(Dwell(duration_s=0.1)).stop_reason.value == "completed"
    joints.away = "protective stop"
    for _ in range(2):
        with pytest.raises(DeviceLost, match="protective stop"):
            arm.dwell(Dwell(duration_s=0.1))
    assert not arm.stop()  # nothing is under way
    joints.positions_rad = joints.positions_rad + BASE * 0.2  # by hand
    joints.away, joints.told = "", None
    elsewhere = joints.positions_rad.copy()
    assert arm.dwell(Dwell(duration_s=0.1)).stop_reason.value == "completed"
    told = joints.was_told()
    assert told is not None and np.array_equal(told, elsewhere)
    outcome = arm.follow(turned(arm, 0.01))
    assert outcome.stop_reason.value == "completed", outcome.detail
    assert outcome.joints_rad == pytest.approx(elsewhere + 0.01 * BASE)
    arm.close()


def test_an_arm_that_was_closed_begins_nothing_more() -> None:
    """Its devices are let go of next, while its service still answers."""
    arm, joints = arm_of(realtime=False)
    arm.close()
    halted, cycles = joints.halted, joints.cycles
    with pytest.raises(CommandRefused, match="being stopped") as refused:
        arm.dwell(Dwell(duration_s=0.1))
    assert refused.value.code == STOPPING and (joints.halted, joints.cycles) == (halted, cycles)


def test_the_loop_asks_again_and_holds_where_the_arm_is() -> None:
    arm, joints = arm_of(realtime=True)
    try:
        joints.away = "cable out"
        with pytest.raises(DeviceLost, match="cable out"):
            arm.dwell(Dwell(duration_s=1.0))
        joints.positions_rad = joints.positions_rad + BASE * 0.2
        elsewhere, joints.told, joints.away = joints.positions_rad.copy(), None, ""
        given_up_s = time.monotonic() + DEADLINE_S
        while (told := joints.was_told()) is None:
            assert time.monotonic() < given_up_s
            time.sleep(0.005)
        assert np.array_equal(told, elsewhere)
    finally:
        arm.close()


def test_the_arm_is_held_while_a_command_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    arm, joints = arm_of(realtime=True)
    waited = threading.Event()

    def judge(*_: object, **__: object) -> None:
        """Ends when the arm's loop has gone on for fifty cycles."""
        until, given_up_s = joints.cycles + 50, time.monotonic() + DEADLINE_S
        while joints.cycles < until and time.monotonic() < given_up_s:
            time.sleep(0.002)
        if joints.cycles >= until:
            waited.set()

    try:
        monkeypatch.setattr(arm._collisions, "check_path", judge)
        outcome = arm.follow(turned(arm, 0.01))
        assert waited.is_set() and outcome.stop_reason.value == "completed"
    finally:
        arm.close()


def test_a_fault_of_a_driver_ends_the_loop_loudly_and_nothing_moves_after_it() -> None:
    arm, joints = arm_of(realtime=True)
    told = threading.Event()
    reasons: list[str] = []

    def on_broken(why: str) -> None:
        reasons.append(why)
        told.set()

    arm.on_broken = on_broken
    try:
        joints.breaks = True
        assert told.wait(DEADLINE_S)
        assert "ZeroDivisionError" in reasons[0] and joints.halted
        joints.breaks = False
        with pytest.raises(DeviceLost, match="ZeroDivisionError"):
            arm.dwell(Dwell(duration_s=0.1))
    finally:
        arm.close()
