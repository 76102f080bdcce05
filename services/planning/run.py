"""One assembly under way: what it knows, what it has counted, and the moves that all strategies are made of."""

from __future__ import annotations

import numpy as np

from crosspih_common.arm.inverse import InverseError, nearest
from crosspih_common.arm.quintic import JointTrajectory
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import (
    ADMITTANCE_MOVE,
    COMPENSATE,
    DWELL,
    FOLLOW,
    GUARDED_MOVE,
    MOVE_LINEAR,
)
from crosspih_common.messages import (
    AdmittanceMove,
    AssemblyPhase,
    CompensateWrench,
    ContactReading,
    Dwell,
    Failure,
    FollowTrajectory,
    GuardedMove,
    GuardedMoveOutcome,
    JointKnot,
    MotionOutcome,
    MoveLinear,
    Phase,
    PoseData,
    PosePrior,
    StopReason,
    Touch,
    floats,
)
from crosspih_common.messages.base import Vector6
from services.planning.config import PlanningConfig
from services.planning.effort import Effort
from services.planning.ports import AssemblyFailed, Ports
from services.planning.trajectory import TrajectoryError, move_joints, move_line, scaled_limits

AT_HOME_RAD = 0.02
BACK_OFF_TRIES = 3  # a wedged peg may be stopped by the cell's caps on its way out
IN_RANGE = 2.0  # times the half ranges of the drawing
IN_RANGE_RAD = 0.5
NEAR_HOLE_M = 0.06  # from the axis of the nominal hole: half the cross, the hole's range, and some
CAPPED = (StopReason.FORCE_CAP, StopReason.MOMENT_CAP)
FreeAir = tuple[Vector6, PoseData] | None


def knots_of(trajectory: JointTrajectory) -> FollowTrajectory:
    """A trajectory for the wire."""
    return FollowTrajectory(
        knots=tuple(
            JointKnot(
                time_s=float(trajectory.times_s[index]),
                joints_rad=floats(trajectory.positions_rad[index]),
                speeds_rad_s=floats(trajectory.velocities_rad_s[index]),
                accelerations_rad_s2=floats(trajectory.accelerations_rad_s2[index]),
            )
            for index in range(len(trajectory.times_s))
        )
    )


class Run:
    """The state of one assembly. Every move is counted; a move stopped by the cell's caps counts as an overload."""

    def __init__(self, workcell: Workcell, config: PlanningConfig, ports: Ports, assembly_id: str) -> None:
        self.workcell, self.config, self.ports = workcell, config, ports
        self.assembly_id = assembly_id
        self.arm = workcell.arm()
        self.limits = scaled_limits(self.arm.limits, config.speed_scale, config.acceleration_scale)
        self.joints_rad: Array = np.asarray(workcell.home_joints_rad, dtype=float)
        self.pose_base_peg = workcell.pose_base_peg(self.joints_rad)
        self.touches: list[Touch] = []
        self.presses: list[Touch] = []
        self.attempt = 0
        self.pushes = self.corrections = self.overloads = 0
        self.motion_s = self.peak_force_n = self.peak_moment_nm = 0.0
        self.effort = Effort()
        self.last_stop = StopReason.COMPLETED  # of the last touch
        self.vision_pose: Pose | None = None
        self.vision_refused = ""
        self.believed: Pose | None = None
        self.known: PosePrior | None = None  # told with the request

    # ------------------------------------------------------------------------------------------------------- telling

    def tell(self, phase: Phase, text: str, **figures: float) -> None:
        """Publish a step."""
        self.ports.tell_phase(
            AssemblyPhase(
                assembly_id=self.assembly_id,
                phase=phase,
                attempt=self.attempt,
                text=text,
                figures={name: round(float(value), 6) for name, value in figures.items()},
            )
        )

    # -------------------------------------------------------------------------------------------------------- moving

    def account(self, outcome: MotionOutcome) -> None:
        """Count a motion; AssemblyFailed OVERLOAD when the caps stopped one once too often."""
        self.effort.add(outcome)
        self.motion_s += outcome.duration_s
        self.peak_force_n = max(self.peak_force_n, outcome.peak_force_n)
        self.peak_moment_nm = max(self.peak_moment_nm, outcome.peak_moment_nm)
        self.joints_rad = np.asarray(outcome.joints_rad)
        self.pose_base_peg = outcome.pose_base_peg.pose()
        if outcome.stop_reason in CAPPED:
            self.overloads += 1
            if self.overloads >= self.config.max_overloads:
                raise AssemblyFailed(
                    Failure.OVERLOAD, f"{outcome.stop_reason.value} for the {self.overloads}. time: {outcome.detail}"
                )

    def forget_forces(self) -> None:
        """What was felt so far was no contact: before it knew the payload the arm took the tool's weight for one."""
        self.peak_force_n = self.peak_moment_nm = 0.0
        self.effort.forget_forces()

    def dwell(self, duration_s: float) -> MotionOutcome:
        """Hold still; also how the run learns where the arm is."""
        outcome = self.ports.ask(DWELL, Dwell(duration_s=duration_s))
        self.account(outcome)
        return outcome

    def follow(self, trajectory: JointTrajectory) -> None:
        """Follow a joint trajectory to its end."""
        outcome = self.ports.ask(FOLLOW, knots_of(trajectory))
        self.account(outcome)
        if outcome.stop_reason is not StopReason.COMPLETED:
            raise AssemblyFailed(
                Failure.OVERLOAD if outcome.stop_reason in CAPPED else Failure.ABORTED,
                f"a free move was stopped: {outcome.stop_reason.value} {outcome.detail}",
            )

    def joints_to(self, joints_rad: Array) -> None:
        """Move all joints together."""
        try:
            self.follow(move_joints(self.joints_rad, joints_rad, self.limits))
        except TrajectoryError as error:
            raise AssemblyFailed(Failure.UNREACHABLE, str(error)) from None

    def line_to(self, pose_base_peg: Pose, speed_m_s: float | None = None) -> None:
        """Move the peg on a straight line in free space."""
        if (
            self.pose_base_peg.distance_to_m(pose_base_peg) < 1e-6
            and self.pose_base_peg.angle_to_rad(pose_base_peg) < 1e-6
        ):
            return
        try:
            self.follow(
                move_line(
                    self.arm,
                    self.joints_rad,
                    pose_base_peg,
                    self.limits,
                    pose_flange_point=self.workcell.pose_flange_peg(),
                    speed_m_s=speed_m_s or self.config.line_speed_m_s,
                )
            )
        except (InverseError, TrajectoryError) as error:
            raise AssemblyFailed(Failure.UNREACHABLE, str(error)) from None

    def slide_to(self, pose_base_peg: Pose, speed_m_s: float = 0.03) -> None:
        """Move the peg on a straight line near or in the hole, the controller watching its caps."""
        try:
            outcome = self.ports.ask(
                MOVE_LINEAR, MoveLinear(pose_base_peg=PoseData.of(pose_base_peg), speed_m_s=speed_m_s)
            )
        except CommandRefused as refusal:
            raise AssemblyFailed(Failure.UNREACHABLE, str(refusal)) from None
        self.account(outcome)

    # ---------------------------------------------------------------------------------------------- before the hole

    def before_hole(self, pose_base_hole: Pose, distance_m: float) -> Pose:
        """`pose_base_peg` aligned with the hole, the tip that far before the face."""
        return pose_base_hole @ Pose.from_translation([0.0, 0.0, -self.workcell.peg.shape().tip_m - distance_m])

    def can_be(self, pose_base_hole: Pose) -> bool:
        """Whether the hole can be there at all; an estimate that says otherwise must not be driven to."""
        off = self.workcell.hole_prior.pose_base_hole().inverse() @ pose_base_hole
        reach_m = IN_RANGE * self.workcell.hole_prior.half_ranges()[:3]
        near = bool(np.all(np.abs(off.translation_m) < reach_m))
        return near and float(np.linalg.norm(off.rotvec_rad())) < IN_RANGE_RAD

    def approach(self, pose_base_hole: Pose, standoff_m: float | None = None) -> None:
        """From wherever the arm is in free space to before the hole: quintic in joints, then straight."""
        start = self.before_hole(pose_base_hole, self.config.approach_m)
        back = self.workcell.pose_flange_peg().inverse()
        try:
            joints = nearest(self.arm, start @ back, self.joints_rad)
        except InverseError as error:
            raise AssemblyFailed(Failure.UNREACHABLE, str(error)) from None
        self.tell(Phase.APPROACHING, "driving to before the hole")
        self.joints_to(joints)
        self.line_to(self.before_hole(pose_base_hole, standoff_m or self.config.standoff_m))

    # ------------------------------------------------------------------------------------------------ push and touch

    def feel(self, duration_s: float = 0.1) -> tuple[MotionOutcome, ContactReading]:
        """Hold still; what is felt."""
        outcome = self.dwell(duration_s)
        request = CompensateWrench(
            pose_base_peg=outcome.pose_base_peg, wrench_raw=outcome.wrench_raw, wrench_sd=outcome.wrench_sd
        )
        return outcome, self.ports.ask(COMPENSATE, request)

    def push(self, pose_base_hole: Pose, force_n: float | None = None) -> bool:
        """A compliant push along the hole's axis from where the peg is; whether it went all the way."""
        shape = self.workcell.peg.shape()
        hole = self.workcell.hole.shape(shape)
        tip = pose_base_hole.inverse().apply(self.pose_base_peg.apply([0.0, 0.0, shape.tip_m]))
        depth = hole.chamfer_m + shape.taper_length_m + self.workcell.insertion_depth_m + self.config.extra_depth_m
        travel = float(depth - tip[2])
        self.pushes += 1
        self.tell(Phase.PUSHING, f"compliant push {self.pushes}", travel_mm=travel * 1e3)
        outcome = self.ports.ask(
            ADMITTANCE_MOVE,
            AdmittanceMove(
                direction_base=floats(pose_base_hole.rotation[:, 2]),
                speed_m_s=self.config.push_speed_m_s,
                travel_m=travel,
                axial_force_n=force_n or self.config.push_force_n,
                stall_s=self.config.push_stall_s,
                timeout_s=self.config.push_timeout_s,
            ),
        )
        self.account(outcome)
        seated = outcome.stop_reason is StopReason.SEATED
        self.tell(
            Phase.SEATED if seated else Phase.PUSHING,
            "in" if seated else f"did not enter: {outcome.stop_reason.value} after {outcome.travel_m * 1e3:.1f} mm",
            travel_mm=outcome.travel_m * 1e3,
            peak_force_n=outcome.peak_force_n,
            peak_moment_nm=outcome.peak_moment_nm,
        )
        return seated

    def touch(
        self,
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
        self.slide_to(pose_base_peg_start)
        self.tell(Phase.TOUCHING, f"touch {len(self.touches) + 1}")
        travel_m = travel_m or self.config.touch_travel_m
        touch: Touch | None = None
        free: FreeAir = None
        for speed, part_m in ((self.config.probe_speed_m_s, slow_travel_m), (speed_m_s, travel_m - slow_travel_m)):
            if part_m <= 0.0:
                continue
            command = GuardedMove(
                direction_base=floats(direction),
                speed_m_s=speed,
                creep_speed_m_s=self.config.touch_creep_m_s,
                force_threshold_n=threshold_n,
                travel_limit_m=part_m,
                retreat_m=self.config.touch_clearance_m,
            )
            outcome = self.ports.ask(GUARDED_MOVE, command)
            self.account(outcome)
            self.last_stop = outcome.stop_reason
            if free is None and outcome.wrench_free_raw is not None:
                free = (outcome.wrench_free_raw, PoseData.of(pose_base_peg_start))
            touch = self._felt(outcome, free)
            if outcome.stop_reason is not StopReason.TRAVEL_LIMIT:
                break
        if touch is not None:
            self.touches.append(touch)
            self.tell(
                Phase.TOUCHING,
                f"felt {np.linalg.norm(touch.wrench[:3]):.1f} N, contact state "
                + (touch.state.case or f"none of the 26 ({touch.state.reason})"),
                force_n=float(np.linalg.norm(touch.wrench[:3])),
                moment_nm=float(np.linalg.norm(touch.wrench[3:])),
                travel_mm=(touch.travel_first_contact_m or 0.0) * 1e3,
                confidence=touch.state.confidence,
            )
        return touch

    def deflected(self, touch: Touch) -> Pose:
        """Where the peg truly was in a touch, `pose_base_peg`: joints and wrist give way to the wrench."""
        twist = self.workcell.compliance_peg(touch.joints_rad) @ np.asarray(touch.wrench)
        return touch.pose_base_peg.pose() @ Pose.from_rotvec(twist[3:], twist[:3])

    def press(self, pose_base_peg_start: Pose, direction: Array) -> None:
        """Press against a wall of the bore from a pose inside it, and come back."""
        command = GuardedMove(
            direction_base=floats(direction),
            speed_m_s=self.config.press_speed_m_s,
            creep_speed_m_s=self.config.press_creep_m_s,
            force_threshold_n=self.config.press_force_n,
            travel_limit_m=self.config.press_travel_m,
        )
        outcome = self.ports.ask(GUARDED_MOVE, command)
        self.account(outcome)
        press = self._felt(outcome, None, seated=True)
        if press is not None:
            self.presses.append(press)
        self.slide_to(pose_base_peg_start, self.config.press_speed_m_s)

    def _felt(self, outcome: GuardedMoveOutcome, free: FreeAir, seated: bool = False) -> Touch | None:
        """What a guarded move felt; `free` is the sensor's reading in free air and where, None when there was none."""
        if outcome.wrench_observed_raw is None or outcome.pose_base_peg_observed is None:
            self.tell(Phase.TOUCHING, f"felt nothing: {outcome.stop_reason.value}", travel_mm=outcome.travel_m * 1e3)
            return None
        reading = self.ports.ask(
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
            index=len(self.touches) + len(self.presses),
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
        self.ports.tell_touch(touch)
        return touch

    def withdraw(self, pose_base_hole: Pose, distance_m: float) -> float:
        """Back along the peg's own axis until the tip is that far before the face; how far before it is, m.

        A push leaves the peg askew in the hole, and any other way out would press it against the walls.
        """
        tip_m = self.workcell.peg.shape().tip_m

        def before_m() -> float:
            return -float(pose_base_hole.inverse().apply(self.pose_base_peg.apply([0.0, 0.0, tip_m]))[2])

        if before_m() < distance_m:
            self.slide_to(self.pose_base_peg @ Pose.from_translation([0.0, 0.0, before_m() - distance_m]))
        return before_m()

    def home(self) -> None:
        """To the home position from wherever the last assembly left the arm; a peg in the hole is taken out first."""
        home = np.asarray(self.workcell.home_joints_rad, dtype=float)
        if np.abs(self.joints_rad - home).max() < AT_HOME_RAD:
            return
        nominal = self.workcell.hole_prior.pose_base_hole()
        x, y, z = nominal.inverse().apply(self.pose_base_peg.apply([0.0, 0.0, self.workcell.peg.shape().tip_m]))
        if np.hypot(x, y) < NEAR_HOLE_M and z > -self.config.approach_m and not self.back_off():
            raise AssemblyFailed(Failure.UNREACHABLE, "the arm is not at home, and the peg cannot be taken out")
        self.joints_to(home)

    def back_off(self) -> bool:
        """Out of the hole along the peg's own axis and clear of the face; whether that was done."""
        self.tell(Phase.BACKING_OFF, "taking the peg out")
        try:
            self.dwell(0.02)
            # clear of where the hole is believed to be, and of where it is drawn, whichever is nearer
            aims = [self.workcell.hole_prior.pose_base_hole(), *([] if self.believed is None else [self.believed])]
            for _ in range(BACK_OFF_TRIES):
                if all([self.withdraw(aim, self.config.approach_m) >= self.config.approach_m - 0.005 for aim in aims]):
                    return True
            return False
        except (AssemblyFailed, CommandRefused) as error:
            self.tell(Phase.BACKING_OFF, f"could not back off: {error}")
            return False
