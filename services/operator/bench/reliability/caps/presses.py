"""The presses: each kind of motion sent at the plate, straight on or oblique, at some speed."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from crosspih_common.arm.inverse import nearest, track
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.holding import ArmLease, hold_arm
from crosspih_common.keys import ADMITTANCE_MOVE, DWELL, FOLLOW, GUARDED_MOVE, MOVE_LINEAR, SET_PAYLOAD, TRUTH
from crosspih_common.messages import (
    AdmittanceMove,
    Dwell,
    FollowTrajectory,
    GuardedMove,
    JointKnot,
    MotionOutcome,
    MoveLinear,
    PoseData,
    ResetCell,
    SetPayload,
    floats,
)
from services.operator.assembly.session import Session

BESIDE_M = (0.036, 0.034)  # the tip's place on the plate, clear of the hole
BEFORE_M = 0.006  # from the tip to the plate, straight on
BEYOND_M = 0.006  # into the plate, for a plate that is not felt
DEADLINE_S = 120.0


class PressCommand(str, Enum):
    """The command that presses."""

    GUARDED = "guarded"
    ADMITTANCE = "admittance"
    LINEAR = "linear"
    FOLLOW = "follow"


# up to the limits of the messages; a followed trajectory has only the joints' own limits
SPEEDS_M_S = {
    PressCommand.GUARDED: (0.005, 0.01, 0.05, 0.1, 0.25),
    PressCommand.ADMITTANCE: (0.005, 0.01, 0.05, 0.1),
    PressCommand.LINEAR: (0.005, 0.02, 0.1, 0.5),
    PressCommand.FOLLOW: (0.005, 0.02, 0.1, 0.3),
}
OBLIQUE_RAD = (0.0, 0.5, 1.0)


class CapPress(BaseModel):
    """One press: `oblique_rad` between the direction and the plate's inward normal, `tilt_rad` of the peg itself."""

    model_config = ConfigDict(frozen=True)

    kind: PressCommand
    speed_m_s: float
    oblique_rad: float
    tilt_rad: float = 0.0
    seed: int = 0


class CapPressResult(BaseModel):
    """The result of a press; `refused` instead of a stop where the command was refused."""

    model_config = ConfigDict(frozen=True)

    press: CapPress
    peak_contact_n: float
    peak_sensed_n: float = 0.0
    stop: str = ""
    refused: str = ""
    notes: tuple[str, ...] = ()


def presses(oblique_rad: tuple[float, ...] = OBLIQUE_RAD) -> Iterator[CapPress]:
    """All of them, in the order of the table."""
    for kind, speeds in SPEEDS_M_S.items():
        for speed in speeds:
            for oblique in oblique_rad:
                yield CapPress(kind=kind, speed_m_s=speed, oblique_rad=oblique)
            yield CapPress(kind=kind, speed_m_s=speed, oblique_rad=0.0, tilt_rad=0.1)


def press_all(session: Session, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Each press in turn, on the session's cell."""
    with hold_arm(session.bus, "bench caps") as lease:
        return [press_once(session, lease, CapPress.model_validate(row)).model_dump(mode="json") for row in rows]


def press_once(session: Session, lease: ArmLease, press: CapPress) -> CapPressResult:
    """Place the peg before the plate, send the motion, return the largest contact force of the engine."""
    workcell = session.cell.workcell
    across = np.tan(press.oblique_rad) * BEFORE_M
    start = Pose.from_rotvec(
        [press.tilt_rad, 0.0, 0.0], [BESIDE_M[0] - across, BESIDE_M[1], -workcell.peg.shape().tip_m - BEFORE_M]
    )
    placed = session.new_trial(ResetCell(seed=press.seed, offset_hole=(0.0,) * 6, place_peg=PoseData.of(start)))
    rest = lease.ask(DWELL, Dwell(duration_s=0.05), DEADLINE_S)
    # in free air and never rotated: the sensor reads exactly the load that hangs on it
    load = SetPayload(bias=rest.wrench_raw, weight_n=0.0, centroid_ft_m=(0.0, 0.0, 0.0), gravity_base=(0.0, 0.0, -1.0))
    lease.ask(SET_PAYLOAD, load, DEADLINE_S)
    hole, peg = placed.pose_base_hole.pose(), placed.pose_base_peg.pose()
    direction = hole.rotation @ np.array([np.sin(press.oblique_rad), 0.0, np.cos(press.oblique_rad)])
    way_m = (BEFORE_M + BEYOND_M) / np.cos(press.oblique_rad)
    goal = Pose(peg.rotation, peg.translation_m + direction * way_m)
    stop, sensed, refused = "", 0.0, ""
    notes: tuple[str, ...] = ()
    try:
        outcome = _send(lease, press, workcell, peg, goal, direction, way_m)
        stop, sensed, notes = outcome.stop_reason.value, outcome.peak_force_n, outcome.notes
    except CommandRefused as refusal:
        refused = str(refusal)
    now_ns = session.bus.clock.now_ns()
    truth = session.bus.latest(TRUTH).wait_for(lambda sample: sample.stamp_ns >= now_ns, 5.0)
    if truth is None or truth.peak_contact_n is None:
        raise CommandRefused("truth", "the cell does not tell its true contact force: hardware.simulated.watch_contact")
    return CapPressResult(
        press=press, peak_contact_n=truth.peak_contact_n, peak_sensed_n=sensed, stop=stop, refused=refused, notes=notes
    )


def _send(
    lease: ArmLease, press: CapPress, workcell: Workcell, peg: Pose, goal: Pose, direction: Array, way_m: float
) -> MotionOutcome:
    towards = floats(direction)
    if press.kind is PressCommand.GUARDED:
        guarded = GuardedMove(direction_base=towards, speed_m_s=press.speed_m_s, travel_limit_m=way_m, retreat_m=0.005)
        return lease.ask(GUARDED_MOVE, guarded, DEADLINE_S)
    if press.kind is PressCommand.ADMITTANCE:
        push = AdmittanceMove(direction_base=towards, speed_m_s=press.speed_m_s, travel_m=way_m, timeout_s=20.0)
        return lease.ask(ADMITTANCE_MOVE, push, DEADLINE_S)
    if press.kind is PressCommand.LINEAR:
        linear = MoveLinear(pose_base_peg=PoseData.of(goal), speed_m_s=press.speed_m_s)
        return lease.ask(MOVE_LINEAR, linear, DEADLINE_S)
    return lease.ask(FOLLOW, _trajectory(workcell, peg, goal, press.speed_m_s, way_m), DEADLINE_S)


def _trajectory(workcell: Workcell, peg: Pose, goal: Pose, speed_m_s: float, way_m: float) -> FollowTrajectory:
    """From pose to pose by joints; the tip's peak speed is about the requested one: a quintic peaks at 1.875 d / T."""
    arm, to_flange = workcell.arm(), workcell.pose_flange_peg().inverse()
    first = nearest(arm, peg @ to_flange, workcell.home_joints_rad)
    last = track(arm, [peg @ to_flange, goal @ to_flange], first)[-1]
    duration_s = 1.875 * way_m / speed_m_s
    return FollowTrajectory(
        knots=(
            JointKnot(time_s=0.0, joints_rad=floats(first)),
            JointKnot(time_s=duration_s, joints_rad=floats(last)),
        )
    )
