"""The peg's motions in an assembly: each is asked of the arm, counted, and ends the assembly where it must."""

from __future__ import annotations

import numpy as np

from crosspih_common.arm.inverse import InverseError, nearest
from crosspih_common.arm.quintic import JointTrajectory
from crosspih_common.collision import CollisionModel
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import (
    DWELL,
    FOLLOW,
    MOVE_LINEAR,
)
from crosspih_common.messages import (
    BROKEN_OFF,
    Dwell,
    Failure,
    FollowTrajectory,
    JointKnot,
    MotionOutcome,
    MoveLinear,
    Phase,
    PoseData,
    StopReason,
    floats,
)
from services.planning.config import PlanningConfig
from services.planning.counts import CAPPED, AssemblyCounts
from services.planning.ports import AssemblyFailed, Ports
from services.planning.telling import PhaseTeller
from services.planning.trajectory import TrajectoryError, move_joints, move_line, scaled_limits


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


class PegMotion:
    """The pose of arm and peg, and their motions.

    Every move is counted; a move stopped by the cell's caps counts as an overload.
    """

    def __init__(
        self, workcell: Workcell, config: PlanningConfig, ports: Ports, counts: AssemblyCounts, tell: PhaseTeller
    ) -> None:
        self._workcell, self._config, self._ports, self._counts, self._tell = workcell, config, ports, counts, tell
        self.arm = workcell.arm()
        self.collisions = CollisionModel(workcell)
        self.limits = scaled_limits(self.arm.limits, config.speed_scale, config.acceleration_scale)
        self.joints_rad: Array = np.asarray(workcell.home_joints_rad, dtype=float)
        self.pose_base_peg = workcell.pose_base_peg(self.joints_rad)

    def account(self, outcome: MotionOutcome) -> None:
        """Count a motion; AssemblyFailed OVERLOAD when the caps stopped one once too often, ARM_STOPPED when the arm
        broke it off."""
        self._counts.add(outcome)
        self.joints_rad = np.asarray(outcome.joints_rad)
        self.pose_base_peg = outcome.pose_base_peg.pose()
        if outcome.stop_reason in BROKEN_OFF:
            raise AssemblyFailed(Failure.ARM_STOPPED, f"{outcome.stop_reason.value}: {outcome.detail}")
        if outcome.stop_reason in CAPPED and self._counts.overloads >= self._config.max_overloads:
            raise AssemblyFailed(
                Failure.OVERLOAD,
                f"{outcome.stop_reason.value} for the {self._counts.overloads}. time: {outcome.detail}",
            )

    def dwell(self, duration_s: float) -> MotionOutcome:
        """Hold still; also how it is learnt where the arm is."""
        outcome = self._ports.ask(DWELL, Dwell(duration_s=duration_s))
        self.account(outcome)
        return outcome

    def follow(self, trajectory: JointTrajectory, *, working: bool = False) -> None:
        """Follow a joint trajectory to its end, its knots joined by straight joint moves or so dense as if.

        Raises AssemblyFailed UNREACHABLE before anything moves if it would come too near to something. `working` lets
        the peg come near the fixture (the rule is in `crosspih_common.collision.model`).
        """
        violation = self.collisions.check_path(trajectory.positions_rad, working=working)
        if violation is not None:
            raise AssemblyFailed(Failure.UNREACHABLE, str(violation))
        outcome = self._ports.ask(FOLLOW, knots_of(trajectory))
        self.account(outcome)
        if outcome.stop_reason is not StopReason.COMPLETED:
            raise AssemblyFailed(
                Failure.OVERLOAD if outcome.stop_reason in CAPPED else Failure.ABORTED,
                f"a free move was stopped: {outcome.stop_reason.value} {outcome.detail}",
            )

    def joints_to(self, joints_rad: Array) -> None:
        """Move all joints together, through free space only."""
        try:
            self.follow(move_joints(self.joints_rad, joints_rad, self.limits))
        except TrajectoryError as error:
            raise AssemblyFailed(Failure.UNREACHABLE, str(error)) from None

    def line_to(self, pose_base_peg: Pose, speed_m_s: float | None = None) -> None:
        """Move the peg on a straight line in free space; it may end before the hole."""
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
                    pose_flange_point=self._workcell.pose_flange_peg(),
                    speed_m_s=speed_m_s or self._config.line_speed_m_s,
                ),
                working=True,
            )
        except (InverseError, TrajectoryError) as error:
            raise AssemblyFailed(Failure.UNREACHABLE, str(error)) from None

    def slide_to(self, pose_base_peg: Pose, speed_m_s: float = 0.03) -> None:
        """Move the peg on a straight line near or in the hole, the controller watching its caps."""
        try:
            outcome = self._ports.ask(
                MOVE_LINEAR, MoveLinear(pose_base_peg=PoseData.of(pose_base_peg), speed_m_s=speed_m_s)
            )
        except CommandRefused as refusal:
            raise AssemblyFailed(Failure.UNREACHABLE, str(refusal)) from None
        self.account(outcome)

    def before_hole(self, pose_base_hole: Pose, distance_m: float) -> Pose:
        """`pose_base_peg` aligned with the hole, the tip that far before the face."""
        return pose_base_hole @ Pose.from_translation([0.0, 0.0, -self._workcell.peg.shape().tip_m - distance_m])

    def approach(self, pose_base_hole: Pose, standoff_m: float | None = None) -> None:
        """From wherever the arm is in free space to before the hole: quintic in joints, then straight."""
        start = self.collisions.before_zone(self.before_hole(pose_base_hole, self._config.approach_m))
        back = self._workcell.pose_flange_peg().inverse()
        try:
            joints = nearest(self.arm, start @ back, self.joints_rad)
        except InverseError as error:
            raise AssemblyFailed(Failure.UNREACHABLE, str(error)) from None
        self._tell(Phase.APPROACHING, "driving to before the hole")
        self.joints_to(joints)
        self.line_to(self.before_hole(pose_base_hole, standoff_m or self._config.standoff_m))
