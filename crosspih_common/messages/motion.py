"""Commands that move the arm, and what was really done."""

from __future__ import annotations

from enum import Enum
from typing import Annotated, Any

from pydantic import Field, model_validator

from crosspih_common.messages.base import (
    MAX_MAGNITUDE,
    Deviations6,
    Direction,
    Frame,
    Joints,
    Message,
    Part,
    PoseData,
    Vector3,
    Vector6,
    same_length,
)

# Below these nothing moves, and is felt, that a wrist sensor or an encoder could tell from rest.
MIN_SPEED_M_S = 1e-6
MIN_SPEED_RAD_S = 1e-6
MIN_TRAVEL_M = 1e-6
MAX_TRAVEL_M = 0.3  # of one guarded move
MIN_TIME_S = 1e-3
MIN_FORCE_N = 1e-3
MIN_MOMENT_NM = 1e-5
MIN_DAMPING = 1e-3  # N s / m, Nm s / rad


class StopReason(str, Enum):
    """Why a motion ended."""

    COMPLETED = "completed"  # all of it was done
    CONTACT = "contact"  # the force threshold of a guarded move was reached
    TRAVEL_LIMIT = "travel_limit"  # a guarded move went all its way and felt nothing
    SEATED = "seated"  # an admittance move reached its travel
    STALLED = "stalled"  # an admittance move no longer advanced
    TIMED_OUT = "timed_out"  # an admittance move ran out of time
    FORCE_CAP = "force_cap"  # |F| passed the cell's cap: stopped and backed off by itself
    MOMENT_CAP = "moment_cap"  # |M| passed the cell's cap: stopped and backed off by itself
    STOPPED = "stopped"  # a stop command came
    HOLDER_LOST = "holder_lost"  # no beat of whoever holds the arm: it stopped by itself
    LATE_CYCLES = "late_cycles"  # the control loop missed too many of its cycles: it stopped by itself
    SENSOR_LOST = "sensor_lost"  # no fresh samples of the force/torque sensor: it stopped by itself


# the arm stopped by itself, and not because of what it touched: whoever sent the motion can no longer rely on it
BROKEN_OFF = (StopReason.HOLDER_LOST, StopReason.LATE_CYCLES, StopReason.SENSOR_LOST)


# of a search about the hole, and of the point on or before the peg about which it yields
SmallOffset = Annotated[tuple[Annotated[float, Field(ge=-0.2, le=0.2)], ...], Field(min_length=3, max_length=3)]
SmallTurn = Annotated[tuple[Annotated[float, Field(ge=-3.2, le=3.2)], ...], Field(min_length=3, max_length=3)]
NearPeg = Annotated[tuple[Annotated[float, Field(ge=-2.0, le=2.0)], ...], Field(min_length=3, max_length=3)]


class Held(Part):
    """Of a command that only the holder of the arm may give. Refused with code `no_lease` to anybody else."""

    lease: str = Field(default="", description="of the present holder; see LeaseGranted")


def _at_rest(knot: dict[str, Any]) -> tuple[float, ...]:
    return (0.0,) * len(knot.get("joints_rad", ()))


class JointKnot(Part):
    """One knot of a joint trajectory; between knots the arm interpolates with a quintic.

    Speeds and accelerations are zero where not given.
    """

    time_s: float = Field(ge=0.0, le=3600.0)
    joints_rad: Joints
    speeds_rad_s: Joints = Field(default_factory=_at_rest)
    accelerations_rad_s2: Joints = Field(default_factory=_at_rest)

    @model_validator(mode="after")
    def _of_one_arm(self) -> JointKnot:
        same_length(self, "joints_rad", "speeds_rad_s", "accelerations_rad_s2")
        return self


class FollowTrajectory(Held, Message):
    """Follow quintic segments through the knots; the first knot is where the arm must now be (0.01 rad)."""

    knots: tuple[JointKnot, ...] = Field(min_length=2, max_length=5000)


class GuardedMove(Held, Message):
    """Move in a straight line, orientation kept, until the force rises.

    At the threshold the arm goes on at `creep_speed_m_s` for `observe_s`; the wrench and the pose are averaged over
    the last `average_s` of that creep, so that sliding friction keeps its direction. Then it
    retreats by `retreat_m` along the way it came.
    """

    direction_base: Direction
    speed_m_s: float = Field(ge=MIN_SPEED_M_S, le=0.25)
    creep_speed_m_s: float = Field(default=0.001, ge=MIN_SPEED_M_S, le=0.05)
    force_threshold_n: float = Field(default=5.0, ge=MIN_FORCE_N, le=MAX_MAGNITUDE)
    moment_threshold_nm: float = Field(default=1.0, ge=MIN_MOMENT_NM, le=MAX_MAGNITUDE)
    travel_limit_m: float = Field(ge=MIN_TRAVEL_M, le=MAX_TRAVEL_M)
    observe_s: float = Field(default=0.1, ge=MIN_TIME_S, le=2.0)
    average_s: float = Field(default=0.025, ge=MIN_TIME_S, le=2.0, description="averaging time at the end of the creep")
    retreat_m: float = Field(default=0.0, ge=0.0, le=0.2)


class PathKnot(Part):
    """A place of a path that is moved along while pushing, about where the move began, in the peg frame of then."""

    time_s: float = Field(ge=MIN_TIME_S, le=60.0)
    offset_m: SmallOffset = Field(
        default=(0.0, 0.0, 0.0), description="of the centre; its component along the push is ignored"
    )
    turn_rad: SmallTurn = Field(default=(0.0, 0.0, 0.0), description="rotation vector, about the centre")


class AdmittanceMove(Held, Message):
    """Push along a direction while yielding to lateral force and to moment, under a force cap.

    The peg yields with `lateral_damping_n_s_m` across the direction and `rotational_damping_nm_s_rad` about
    `centre_peg_m` (a point in the peg frame). Along the direction it advances at `speed_m_s`, slower as the axial force
    nears `axial_force_n`. It ends when it has travelled `travel_m` (seated), when it no longer advances, or at
    `timeout_s`.

    With a `path` the peg searches while it pushes: the path (straight between its knots, from no offset and no turn at
    0 s) is moved along on top of the yielding, and the move ends when the path does (completed) instead of stalling.
    """

    direction_base: Direction
    speed_m_s: float = Field(ge=MIN_SPEED_M_S, le=0.1)
    travel_m: float = Field(ge=MIN_TRAVEL_M, le=0.2)
    axial_force_n: float = Field(default=20.0, ge=MIN_FORCE_N, le=MAX_MAGNITUDE)
    lateral_damping_n_s_m: float = Field(default=2000.0, ge=MIN_DAMPING, le=MAX_MAGNITUDE)
    rotational_damping_nm_s_rad: float = Field(default=20.0, ge=MIN_DAMPING, le=MAX_MAGNITUDE)
    centre_peg_m: NearPeg = (0.0, 0.0, 0.057)
    lateral_speed_limit_m_s: float = Field(default=0.003, ge=MIN_SPEED_M_S, le=0.5)
    rotational_speed_limit_rad_s: float = Field(default=0.05, ge=MIN_SPEED_RAD_S, le=3.0)
    stall_s: float = Field(default=0.6, ge=MIN_TIME_S, le=60.0)
    timeout_s: float = Field(default=8.0, ge=MIN_TIME_S, le=60.0)
    path: tuple[PathKnot, ...] = Field(default=(), max_length=20000)


class MoveLinear(Held, Message):
    """Move the peg frame in a straight line, orientation turned along, to a pose in the base frame."""

    pose_base_peg: PoseData
    speed_m_s: float = Field(default=0.05, ge=MIN_SPEED_M_S, le=0.5)
    rotational_speed_rad_s: float = Field(default=0.5, ge=MIN_SPEED_RAD_S, le=3.0)


class Dwell(Held, Message):
    """Hold still and average the sensor."""

    duration_s: float = Field(ge=MIN_TIME_S, le=10.0)


class StopMotion(Message):
    """End whatever moves, now."""


class SetPayload(Held, Message):
    """What hangs behind the sensor and the sensor's bias, so that caps, thresholds and admittance see contact only.

    As a calibration tells them: `bias` in N and Nm and the centroid in the sensor's frame, the raw numbers read as
    `cell.force_torque` says.
    """

    bias: Vector6
    weight_n: float = Field(ge=0.0, le=MAX_MAGNITUDE)
    centroid_ft_m: Vector3
    gravity_base: Vector3 = Field(description="unit vector, the way things fall")


class MotionOutcome(Message):
    """What was really done. Poses are motor-side: the deflection of joints and wrist is not in them.

    `wrench_raw` is the sensor's own mean over the last samples, bias and gravity included, about {K}; `wrench_sd` the
    standard deviation of that mean. `peak_force_n` and `peak_moment_nm` are of the contact wrench as the arm saw it.
    """

    stop_reason: StopReason
    detail: str = ""
    notes: tuple[str, ...] = Field(
        default=(), description="where the motion differed from the request, such as a lower speed"
    )
    start_stamp_ns: int
    duration_s: float
    travel_m: float
    joints_rad: Joints
    pose_base_peg: PoseData
    frame: Frame = Frame.FT
    wrench_raw: Vector6
    wrench_sd: Deviations6
    peak_force_n: float
    peak_moment_nm: float
    # what scoring sums up; a driver that does not know them leaves them out
    tip_path_m: float = Field(default=0.0, ge=0.0, description="length of the tip's way")
    moving_s: float = Field(default=0.0, ge=0.0, description="time in which the tip was faster than 10 mm/s")
    jerk_integral_m_s2: float = Field(default=0.0, ge=0.0, description="of the tip's |jerk| over that time")
    contact_s: float = Field(default=0.0, ge=0.0, description="time in which |F| was above 2 N")
    contact_impulse_n_s: float = Field(default=0.0, ge=0.0, description="integral of |F| over that time")
    over_20_n_s: float = Field(default=0.0, ge=0.0, description="time in which |F| was above 20 N")


class GuardedMoveOutcome(MotionOutcome):
    """Adds the moment of touching. All None when nothing was touched.

    `pose_base_peg_observed` is the mean motor-side pose over exactly the samples of `wrench_observed_raw`;
    `travel_first_contact_m` is the travel at which the force first left the noise (onset, not threshold).
    """

    direction_base: Direction
    travel_first_contact_m: float | None = None
    pose_base_peg_first_contact: PoseData | None = None
    pose_base_peg_observed: PoseData | None = None
    joints_observed_rad: Joints | None = None
    wrench_observed_raw: Vector6 | None = None
    wrench_observed_sd: Deviations6 | None = None
    wrench_free_raw: Vector6 | None = Field(
        default=None, description="the sensor's mean at the start of the move, before any contact"
    )


class PayloadAccepted(Message):
    """The payload that the arm now uses."""

    weight_n: float


class StopAccepted(Message):
    """Whether anything was moving when the stop came."""

    was_moving: bool
