"""Sends the arm commands that it must refuse, chosen so that an arm which obeys does next to nothing.

A trajectory out of a joint's range begins with fifty seconds of standing still, and is stopped before they are over. A
move beyond the cap is a tenth of a millimetre, away from the hole. A false payload is set back.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as StillGoing

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.bus import Bus
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry.pose import Array
from crosspih_common.holding import ArmLease
from crosspih_common.keys import FOLLOW, GUARDED_MOVE, SET_PAYLOAD, STOP
from crosspih_common.messages import (
    FollowTrajectory,
    FtCalibration,
    GuardedMove,
    JointKnot,
    Message,
    MotionOutcome,
    SetPayload,
    StopMotion,
    floats,
)
from crosspih_common.wrench import IMPLAUSIBLE, SensorMounting
from services.operator.cell.check.refused import CommandEnd, check_refused
from services.operator.cli.rows import Row, skipped, wrong_ones

ASK_S = 120.0
LIMIT, START = "joint limit refused", "wrong start refused"
CAP, PAYLOAD = "threshold beyond the cap refused", "payload that hides a load refused"
STAND_S, GO_S = 50.0, 20.0
STOPS_S = 3.0
BEYOND_RAD = 0.05
JUMP_RAD = 0.02  # twice the deviation of the start that the contract allows
ABSURD_N = 1e5
HIDDEN_N = 50.0


def beyond(joints_rad: Array, model: ArmModel) -> Array:
    """Joints (n,), with the one nearest to its limit moved a little beyond it."""
    up, down = model.limits.upper_rad - joints_rad, joints_rad - model.limits.lower_rad
    joint = int(np.argmin(np.minimum(up, down)))
    goal = np.array(joints_rad, dtype=float)
    goal[joint] += up[joint] + BEYOND_RAD if up[joint] < down[joint] else -(down[joint] + BEYOND_RAD)
    return goal


def provoke(
    bus: Bus,
    lease: ArmLease,
    model: ArmModel,
    mounting: SensorMounting,
    still: MotionOutcome,
    calibration: FtCalibration | None,
) -> list[Row]:
    """The four refusals; `still` is the outcome of the latest dwell."""
    here = np.asarray(still.joints_rad, float)
    out = (
        JointKnot(time_s=0.0, joints_rad=floats(here)),
        JointKnot(time_s=STAND_S, joints_rad=floats(here)),
        JointKnot(time_s=STAND_S + GO_S, joints_rad=floats(beyond(here, model))),
    )
    checks = [
        check_refused(
            LIMIT,
            _follow(bus, lease, out),
            ("joint_limit",),
            "refuse a trajectory that leaves a joint's range, before anything moves",
        )
    ]
    if wrong_ones(checks):
        said = "not asked of an arm that does not heed its limits"
        return [*checks, *(skipped(name, said) for name in (START, CAP, PAYLOAD))]
    jumped = here.copy()
    jumped[-1] += JUMP_RAD if model.limits.upper_rad[-1] - jumped[-1] > JUMP_RAD else -JUMP_RAD
    start = tuple(JointKnot(time_s=at, joints_rad=floats(jumped)) for at in (0.0, 1.0))
    checks.append(
        check_refused(
            START,
            _follow(bus, lease, start),
            ("wrong_start",),
            "refuse a trajectory whose first knot is more than 0.01 rad from where the arm is: it would jump there",
        )
    )
    back = -still.pose_base_peg.pose().rotation[:, 2]
    press = GuardedMove(
        direction_base=floats(back), speed_m_s=0.001, travel_limit_m=1e-4, force_threshold_n=ABSURD_N, observe_s=0.01
    )
    checks.append(
        check_refused(
            CAP,
            _ask(lambda: lease.ask(GUARDED_MOVE, press, ASK_S)),
            ("cap",),
            "refuse a threshold from which the arm cannot stop before its cap (docs/safety.md)",
        )
    )
    checks.append(_payload(lease, mounting.sensor(still.wrench_raw), calibration))
    return checks


def _payload(lease: ArmLease, at_rest: Array, calibration: FtCalibration | None) -> Row:
    """`at_rest` (6,): what the sensor reads, N and Nm, in its own frame."""
    bias = at_rest.copy()
    bias[0] += HIDDEN_N
    known = calibration is not None and calibration.calibrated
    gravity = calibration.gravity_base if calibration is not None and known else (0.0, 0.0, -1.0)
    false = SetPayload(bias=floats(bias), weight_n=0.0, centroid_ft_m=(0.0, 0.0, 0.0), gravity_base=gravity)
    answer = _ask(lambda: lease.ask(SET_PAYLOAD, false, ASK_S))
    if answer.code is None:
        honest = false.model_copy(update={"bias": floats(at_rest)})
        if calibration is not None and known:
            honest = SetPayload(
                bias=calibration.bias, weight_n=calibration.weight_n, centroid_ft_m=calibration.centroid_m,
                gravity_base=gravity,
            )  # fmt: skip
        lease.ask(SET_PAYLOAD, honest, ASK_S)
    return check_refused(
        PAYLOAD,
        answer,
        (IMPLAUSIBLE,),
        f"hold arm/set_payload to what the sensor reads at rest: this one hides {HIDDEN_N:g} N from the caps",
    )


def _ask(ask: Callable[[], Message]) -> CommandEnd:
    try:
        done = ask()
    except CommandRefused as refusal:
        return CommandEnd(refusal.code, refusal.text)
    return CommandEnd(None, getattr(getattr(done, "stop_reason", None), "value", "accepted"))


def _follow(bus: Bus, lease: ArmLease, knots: tuple[JointKnot, ...]) -> CommandEnd:
    """Send a command, and stop it if it was not refused at once."""
    with ThreadPoolExecutor(1) as asking:
        moving = asking.submit(_ask, lambda: lease.ask(FOLLOW, FollowTrajectory(knots=knots), ASK_S))
        try:
            return moving.result(timeout=0.3)
        except StillGoing:
            until = time.monotonic() + STOPS_S
            while not moving.done() and time.monotonic() < until:
                bus.call(STOP, StopMotion(), ASK_S)
                time.sleep(0.02)
            if not moving.done():  # if the stop is ignored, releasing the arm also ends the motion
                lease.give()
                moving.result()
                lease.take()
            return moving.result()
