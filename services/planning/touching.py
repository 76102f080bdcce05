"""Push and touch: the moves in contact that all strategies are made of."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import ADMITTANCE_MOVE, COMPENSATE, GUARDED_MOVE
from crosspih_common.messages import (
    AdmittanceMove,
    CompensateWrench,
    ContactReading,
    Failure,
    GuardedMove,
    GuardedMoveOutcome,
    MotionOutcome,
    Phase,
    PoseData,
    StopReason,
    Touch,
    floats,
)
from crosspih_common.messages.base import Vector6
from services.planning.gentle import OBSERVE_S, Gentle
from services.planning.ports import AssemblyFailed
from services.planning.run import Run

RELAXATIONS = 3
AT_REST_N = 3.0
AT_REST_NM = 0.15
LATERAL_DAMPING_N_S_M = 2000.0  # of a push in a cell that is soft enough for it
ROTATIONAL_DAMPING_NM_S_RAD = 20.0
FreeAir = tuple[Vector6, PoseData] | None


def feel(run: Run, duration_s: float = 0.1) -> tuple[MotionOutcome, ContactReading]:
    """Hold still; what is felt."""
    outcome = run.motion.dwell(duration_s)
    request = CompensateWrench(
        pose_base_peg=outcome.pose_base_peg, wrench_raw=outcome.wrench_raw, wrench_sd=outcome.wrench_sd
    )
    return outcome, run.ports.ask(COMPENSATE, request)


def push(run: Run, pose_base_hole: Pose, force_n: float | None = None) -> bool:
    """A compliant push along the hole's axis from where the peg is; whether it went all the way."""
    shape = run.workcell.peg.shape()
    hole = run.workcell.hole.shape(shape)
    tip = pose_base_hole.inverse().apply(run.motion.pose_base_peg.apply([0.0, 0.0, shape.tip_m]))
    depth = hole.chamfer_m + shape.taper_length_m + run.workcell.insertion_depth_m + run.config.extra_depth_m
    travel = float(depth - tip[2])
    force_n = force_n or run.config.push_force_n
    gentle = Gentle.at(run.workcell, run.motion.joints_rad)
    speed_m_s = gentle.push_speed_m_s(run.config, force_n)
    run.counts.pushes += 1
    run.tell(Phase.PUSHING, f"compliant push {run.counts.pushes}", travel_mm=travel * 1e3)
    outcome = run.ports.ask(
        ADMITTANCE_MOVE,
        AdmittanceMove(
            direction_base=floats(pose_base_hole.rotation[:, 2]),
            speed_m_s=speed_m_s,
            travel_m=travel,
            axial_force_n=force_n,
            lateral_damping_n_s_m=gentle.lateral_damping_n_s_m(LATERAL_DAMPING_N_S_M),
            rotational_damping_nm_s_rad=gentle.rotational_damping_nm_s_rad(ROTATIONAL_DAMPING_NM_S_RAD),
            stall_s=run.config.push_stall_s,
            timeout_s=min(60.0, run.config.push_timeout_s * run.config.push_speed_m_s / speed_m_s),
        ),
    )
    run.motion.account(outcome)
    seated = outcome.stop_reason is StopReason.SEATED
    run.tell(
        Phase.SEATED if seated else Phase.PUSHING,
        "in" if seated else f"did not enter: {outcome.stop_reason.value} after {outcome.travel_m * 1e3:.1f} mm",
        travel_mm=outcome.travel_m * 1e3,
        peak_force_n=outcome.peak_force_n,
        peak_moment_nm=outcome.peak_moment_nm,
    )
    return seated


def touch_from(
    run: Run,
    pose_base_peg_start: Pose,
    direction: Array,
    speed_m_s: float,
    threshold_n: float,
    travel_m: float | None = None,
    slow_travel_m: float = 0.0,
) -> Touch | None:
    """Guarded move from a start pose in free air; the touch as felt, or None when nothing was there.

    The first `slow_travel_m` are gone at the probe speed: that is where the face may be, and it is hard.
    """
    run.motion.slide_to(pose_base_peg_start)
    run.tell(Phase.TOUCHING, f"touch {len(run.touches) + 1}")
    travel_m = travel_m or run.config.touch_travel_m
    touch: Touch | None = None
    free: FreeAir = None
    gentle = Gentle.at(run.workcell, run.motion.joints_rad)
    slowly_m_s, speed_m_s = gentle.probe_speed_m_s(run.config), gentle.touch_speed_m_s(run.config, speed_m_s)
    for speed, part_m in ((slowly_m_s, slow_travel_m), (speed_m_s, travel_m - slow_travel_m)):
        if part_m <= 0.0:
            continue
        command = GuardedMove(
            direction_base=floats(direction),
            speed_m_s=speed,
            creep_speed_m_s=gentle.creep_m_s(run.config),
            observe_s=OBSERVE_S,
            force_threshold_n=threshold_n,
            travel_limit_m=part_m,
            retreat_m=run.config.touch_clearance_m,
        )
        outcome = run.ports.ask(GUARDED_MOVE, command)
        run.motion.account(outcome)
        run.last_stop = outcome.stop_reason
        if free is None and outcome.wrench_free_raw is not None:
            free = (outcome.wrench_free_raw, PoseData.of(pose_base_peg_start))
        touch = _felt(run, outcome, free)
        if outcome.stop_reason is not StopReason.TRAVEL_LIMIT:
            break
    if touch is not None:
        run.touches.append(touch)
        run.tell(
            Phase.TOUCHING,
            f"felt {np.linalg.norm(touch.wrench[:3]):.1f} N, contact state "
            + (touch.state.case or f"none of the 26 ({touch.state.reason})"),
            force_n=float(np.linalg.norm(touch.wrench[:3])),
            moment_nm=float(np.linalg.norm(touch.wrench[3:])),
            travel_mm=(touch.travel_first_contact_m or 0.0) * 1e3,
            confidence=touch.state.confidence,
        )
    return touch


def deflected(run: Run, touch: Touch) -> Pose:
    """Where the peg truly was in a touch, `pose_base_peg`: joints, wrist and contact give way to the wrench."""
    twist = run.workcell.compliance_peg(touch.joints_rad) @ np.asarray(touch.wrench)
    return touch.pose_base_peg.pose() @ Pose.from_rotvec(twist[3:], twist[:3])


def press(run: Run, pose_base_peg_start: Pose, direction: Array) -> None:
    """Press against a wall of the bore from a pose inside it, and come back."""
    command = GuardedMove(
        direction_base=floats(direction),
        speed_m_s=run.config.press_speed_m_s,
        creep_speed_m_s=Gentle.at(run.workcell, run.motion.joints_rad).press_creep_m_s(run.config),
        observe_s=OBSERVE_S,
        force_threshold_n=run.config.press_force_n,
        travel_limit_m=run.config.press_travel_m,
    )
    outcome = run.ports.ask(GUARDED_MOVE, command)
    run.motion.account(outcome)
    try:
        pressed = _felt(run, outcome, None, seated=True)
        if pressed is not None:
            run.presses.append(pressed)
    finally:
        # also where nobody is left to say what was felt: the peg is not left pressing
        run.motion.slide_to(pose_base_peg_start, run.config.press_speed_m_s)


def _felt(run: Run, outcome: GuardedMoveOutcome, free: FreeAir, seated: bool = False) -> Touch | None:
    """What a guarded move felt; `free` is the sensor's reading in free air and where, None when there was none."""
    if outcome.wrench_observed_raw is None or outcome.pose_base_peg_observed is None:
        run.tell(Phase.TOUCHING, f"felt nothing: {outcome.stop_reason.value}", travel_mm=outcome.travel_m * 1e3)
        return None
    reading = run.ports.ask(
        COMPENSATE,
        CompensateWrench(
            pose_base_peg=outcome.pose_base_peg_observed,
            wrench_raw=outcome.wrench_observed_raw,
            wrench_sd=outcome.wrench_observed_sd or (0.02, 0.02, 0.02, 0.001, 0.001, 0.001),
            wrench_free_raw=None if free is None else free[0],
            pose_base_peg_free=None if free is None else free[1],
        ),
    )
    touch = Touch(
        stamp_ns=outcome.stamp_ns,
        index=len(run.touches) + len(run.presses),
        seated=seated,
        pose_base_peg=outcome.pose_base_peg_observed,
        pose_base_peg_first_contact=outcome.pose_base_peg_first_contact,
        travel_first_contact_m=outcome.travel_first_contact_m,
        direction_base=outcome.direction_base,
        joints_rad=outcome.joints_observed_rad or outcome.joints_rad,
        wrench=reading.wrench,
        wrench_sd=reading.wrench_sd,
        state=reading.state,
    )
    run.ports.publish_touch(touch)
    return touch


def relax(run: Run) -> tuple[MotionOutcome, ContactReading]:
    """Hold still and feel. A push in askew leaves the arm bent against the bore: it goes to where the peg already is
    until little is felt, for the friction of a wedged peg says nothing about its walls."""
    for left in range(RELAXATIONS, -1, -1):
        outcome, reading = feel(run)
        wrench = np.asarray(reading.wrench)
        if left == 0 or (np.linalg.norm(wrench[:3]) < AT_REST_N and np.linalg.norm(wrench[3:]) < AT_REST_NM):
            break
        twist = run.workcell.arm_compliance_peg(outcome.joints_rad) @ wrench
        try:
            yielded = run.motion.pose_base_peg @ Pose.from_rotvec(twist[3:], twist[:3])
            run.motion.slide_to(yielded, run.config.press_speed_m_s)
        except AssemblyFailed as refused:
            if refused.failure is not Failure.UNREACHABLE:
                raise
            break  # it cannot give way any further; what was felt counts
    return outcome, reading
