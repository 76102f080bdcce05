"""A move that comes too near is refused, naming part, obstacle and distance, before anything is asked of the arm."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from crosspih_common.arm.inverse import nearest
from crosspih_common.collision import CollisionModel
from crosspih_common.config import Surroundings, Workcell
from crosspih_common.geometry import Pose
from crosspih_common.keys import Command
from crosspih_common.messages import AssemblyPhase, Failure, FtCalibration, MotionOutcome, Touch
from services.planning.calibrating import calibrate
from services.planning.config import PlanningConfig
from services.planning.ports import AssemblyFailed, ReplyT, RequestT
from services.planning.run import Run

CELL = Workcell()


class NobodyIsAsked:
    """Ports that must not be used."""

    def ask(self, command: Command[RequestT, ReplyT], request: RequestT) -> ReplyT:
        raise AssertionError(f"asked for {command.path}")

    def look(self, dwell: Callable[[], MotionOutcome]) -> MotionOutcome:
        raise AssertionError("looked at the cell")

    def ft_calibration(self) -> FtCalibration | None:
        return None

    def publish_phase(self, phase: AssemblyPhase) -> None:
        pass

    def publish_touch(self, touch: Touch) -> None:
        pass

    def publish_event(self, code: str, text: str) -> None:
        pass

    def report_defect(self, error: Exception) -> None:
        pass

    def ignore_abort(self) -> None:
        pass


def run_in(**surroundings: object) -> Run:
    workcell = Workcell(surroundings=Surroundings.model_validate(surroundings))
    return Run(workcell, PlanningConfig(), NobodyIsAsked(), "test")


def post_at(point_m: list[float]) -> dict[str, object]:
    return {"name": "the post", "size_m": [0.02, 0.02, 0.02], "position_m": point_m}


def test_a_joint_move_is_refused() -> None:
    goal = nearest(CELL.arm(), Run(CELL, PlanningConfig(), NobodyIsAsked(), "").motion.before_hole(
        CELL.hole_prior.pose_base_hole(), 0.06) @ CELL.pose_flange_peg().inverse(), CELL.home_joints_rad)  # fmt: skip
    middle = CELL.pose_base_peg((np.asarray(CELL.home_joints_rad) + goal) / 2).apply([0.0, 0.0, 0.05])
    with pytest.raises(AssemblyFailed, match=r"the (peg|tool) would .* of the post \(want 15 mm\)") as failed:
        run_in(boxes=[post_at(middle.tolist())]).motion.joints_to(goal)
    assert failed.value.failure is Failure.UNREACHABLE


def test_an_approach_is_refused_on_its_straight_part() -> None:
    run = run_in(keep_out=[post_at(CELL.hole_prior.pose_base_hole().apply([0.0, 0.0, -0.03]).tolist())])
    before = run.motion.before_hole(CELL.hole_prior.pose_base_hole(), 0.1)
    run.motion.joints_rad = nearest(run.motion.arm, before @ CELL.pose_flange_peg().inverse(), CELL.home_joints_rad)
    run.motion.pose_base_peg = before
    with pytest.raises(AssemblyFailed, match=r"unreachable: the peg would come within \d+ mm of the post"):
        run.motion.line_to(before @ Pose.from_translation([0.0, 0.0, 0.095]))


def test_a_joint_move_through_the_fixture_is_refused() -> None:
    run = run_in()
    inside = run.motion.before_hole(CELL.hole_prior.pose_base_hole(), -0.02)
    with pytest.raises(AssemblyFailed, match=r"the peg would .* the fixture"):
        run.motion.joints_to(nearest(run.motion.arm, inside @ CELL.pose_flange_peg().inverse(), CELL.home_joints_rad))


def test_a_calibration_without_room_says_what_is_in_the_way() -> None:
    home = CollisionModel(CELL).clearance(CELL.home_joints_rad)
    assert home.distance_m > 0.015
    at_tip = CELL.pose_base_peg(CELL.home_joints_rad).apply([0.0, 0.0, 0.09]).tolist()
    with pytest.raises(AssemblyFailed, match=r"no poses to calibrate in: .*between the peg and the post"):
        calibrate(run_in(boxes=[post_at(at_tip)]), 0.1)
