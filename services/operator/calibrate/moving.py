"""Holds the arm for a calibration: free moves by joints, dwells, pairs of pictures."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from crosspih_common.arm.quintic import REST_PEAK_ACCELERATION, REST_PEAK_SPEED
from crosspih_common.bus import Bus
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused, CrosspihError, NoService
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.holding import ArmLease
from crosspih_common.keys import CAPTURE, DWELL, FOLLOW, GUARDED_MOVE, IMAGE_LEFT, IMAGE_RIGHT, MOVE_LINEAR
from crosspih_common.messages import (
    CaptureStereo,
    Dwell,
    FollowTrajectory,
    GuardedMove,
    GuardedMoveOutcome,
    JointKnot,
    MotionOutcome,
    MoveLinear,
    PoseData,
    StereoPair,
    StopReason,
    floats,
)
from crosspih_common.messages.images import Image

MOVE_S, LOOK_S, PICTURE_S = 300.0, 180.0, 30.0  # a busy machine draws a simulated picture slowly
SETTLE_S = 0.15
PATIENCE_S, AGAIN_S = 60.0, 0.5
SHORTEST_S = 0.05


class MoveEnded(CrosspihError):
    """A free move ended early: something was touched, or the arm aborted it."""


def captured(bus: Bus) -> StereoPair:
    """A pair of pictures; asked for again for a while if the camera is away, because a picture moves nothing.

    Raises as `Bus.call`.
    """
    give_up_at = time.monotonic() + PATIENCE_S
    while True:
        try:
            return bus.call(CAPTURE, CaptureStereo(), LOOK_S)
        except NoService:
            if time.monotonic() > give_up_at:
                raise
            time.sleep(AGAIN_S)


class HeldArm:
    """An arm that is held; speeds are shares of its limits."""

    def __init__(self, bus: Bus, lease: ArmLease, workcell: Workcell, speed_share: float = 0.3) -> None:
        self._bus, self._lease, self.workcell = bus, lease, workcell
        self._share = speed_share
        self.joints_rad: Array = np.asarray(workcell.home_joints_rad, float)

    def dwell(self, duration_s: float) -> MotionOutcome:
        """Hold still and average. Raises CommandRefused, MoveEnded."""
        return self._completed(self._lease.ask(DWELL, Dwell(duration_s=duration_s), MOVE_S), "holding still")

    def go(self, way: Sequence[Array]) -> MotionOutcome | None:
        """Move through joint knots, stopping in each; None where there is nowhere to move. Raises CommandRefused,
        MoveEnded.
        """
        limits, outcome = self.workcell.arm().limits, None
        for goal in way:
            off = np.abs(goal - self.joints_rad)
            if float(off.max()) < 1e-9:
                continue
            duration_s = max(
                SHORTEST_S,
                float(np.max(REST_PEAK_SPEED * off / (self._share * limits.speed_rad_s))),
                float(np.max(np.sqrt(REST_PEAK_ACCELERATION * off / (self._share * limits.acceleration_rad_s2)))),
            )
            knots = (
                JointKnot(time_s=0.0, joints_rad=floats(self.joints_rad)),
                JointKnot(time_s=duration_s, joints_rad=floats(goal)),
            )
            asked = FollowTrajectory(knots=knots)
            outcome = self._completed(self._lease.ask(FOLLOW, asked, MOVE_S), "a free move")
        return outcome

    def slide(self, pose_base_peg: Pose, speed_m_s: float = 0.02, turn_rad_s: float = 0.3) -> MotionOutcome:
        """Move the peg on a straight line under the arm's caps. Raises CommandRefused, MoveEnded."""
        asked = MoveLinear(
            pose_base_peg=PoseData.of(pose_base_peg), speed_m_s=speed_m_s, rotational_speed_rad_s=turn_rad_s
        )
        return self._completed(self._lease.ask(MOVE_LINEAR, asked, MOVE_S), "a straight move")

    def touch(self, request: GuardedMove) -> GuardedMoveOutcome:
        """A guarded move; any end is returned except an abort by the arm. Raises CommandRefused, MoveEnded."""
        outcome = self._lease.ask(GUARDED_MOVE, request, MOVE_S)
        self.joints_rad = np.asarray(outcome.joints_rad, float)
        if outcome.stop_reason not in (StopReason.CONTACT, StopReason.TRAVEL_LIMIT):
            raise MoveEnded(f"a touch was ended: {outcome.stop_reason.value} {outcome.detail}")
        return outcome

    def _completed(self, outcome: MotionOutcome, what: str) -> MotionOutcome:
        self.joints_rad = np.asarray(outcome.joints_rad, float)
        if outcome.stop_reason is not StopReason.COMPLETED:
            raise MoveEnded(f"{what} was ended: {outcome.stop_reason.value} {outcome.detail}")
        return outcome

    def look(self) -> tuple[StereoPair, Image, Image]:
        """Take a pair of pictures with the arm at rest. Raises CommandRefused `no_picture`, and as `Bus.call`."""
        with self._bus.reading(IMAGE_LEFT, 4) as left, self._bus.reading(IMAGE_RIGHT, 4) as right:
            pair = captured(self._bus)
            pictures = [
                heard.wait_for(lambda image: image.stamp_ns == pair.stamp_ns, PICTURE_S) for heard in (left, right)
            ]
        if pictures[0] is None or pictures[1] is None:
            name = "left" if pictures[0] is None else "right"
            raise CommandRefused("no_picture", f"the {name} picture did not come; `crosspih cell check` says more")
        return pair, pictures[0], pictures[1]
