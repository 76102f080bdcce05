"""An assembly from start to end."""

from __future__ import annotations

import re
from enum import Enum
from typing import Annotated, Any

from pydantic import Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from crosspih_common.messages.base import MAX_MAGNITUDE, Covariance6, Frame, Message, PoseData
from crosspih_common.messages.estimate import PosePrior

MAX_NAME = 200
OWN_STRATEGY = r"^[A-Za-z_][A-Za-z0-9_.-]*(:[A-Za-z_][A-Za-z0-9_]*)?$"


class Strategy(str, Enum):
    """How to get the peg in."""

    FUSED = "fused"  # 6-DoF vision, compliant push, touches fused by the estimator
    FORCE_ALONE = "force_alone"  # no vision: the hole is felt for, then touches fused by the estimator
    PAPER = "paper"  # the paper's loop: position-only vision, one wrench -> network -> correct
    # what fused is compared with; each says in its module what it does
    STRAIGHT = "straight"  # vision, one straight push that stops when it feels more than a limit
    VISION_ONLY = "vision_only"  # vision, position-controlled insertion
    SPIRAL = "spiral"  # vision, compliant push, Archimedean spiral where that does not enter
    TILT = "tilt"  # vision, compliant push, random tilts about the rim where that does not enter
    ADMITTANCE = "admittance"  # vision, compliant pushes alone
    NETWORK_SPIRAL = "network_spiral"  # vision, the paper's network, and a spiral after each correction
    SEQUENCE = "sequence"  # vision, touches through a recurrent network to the pose
    KNOWN_POSE = "known_pose"  # the hole's pose is told, from an assembly with another peg: a compliant push alone


class OwnStrategy(str):
    """One of somebody's own, by its name: `my_lab.mine:Strategy`, or one that an installed package declares."""

    __slots__ = ()

    @property
    def value(self) -> str:
        """The name, as of a Strategy."""
        return str(self)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        named = core_schema.str_schema(pattern=OWN_STRATEGY, max_length=MAX_NAME, strict=True)
        return core_schema.no_info_after_validator_function(
            cls, named, serialization=core_schema.plain_serializer_function_ser_schema(str)
        )


AnyStrategy = Annotated[Strategy | OwnStrategy, Field(union_mode="left_to_right")]


def strategy_of(name: str) -> Strategy | OwnStrategy:
    """Ours of that name, or somebody's own. Raises ValueError where it can be neither, with what was perhaps meant."""
    if name in (ours := [one.value for one in Strategy]):
        return Strategy(name)
    if not re.match(OWN_STRATEGY, name) or len(name) > MAX_NAME:
        raise ValueError(f"strategy {name}: want {', '.join(ours)}, or your own as module:Class")
    return OwnStrategy(name)


class Phase(str, Enum):
    """The state machine of an assembly, in order; CORRECTING and PUSHING may repeat."""

    IDLE = "idle"
    CALIBRATING = "calibrating"  # the F/T sensor, if it never was
    LOCATING = "locating"  # vision looks
    APPROACHING = "approaching"  # quintic trajectory to before the hole
    PUSHING = "pushing"  # compliant push along the hole's axis
    TOUCHING = "touching"  # guarded move until something is felt
    ESTIMATING = "estimating"  # touches to pose
    CORRECTING = "correcting"  # move to where the estimate says
    SEATED = "seated"  # inserted: the pose T2 is known
    BACKING_OFF = "backing_off"  # something failed: out of the hole, away from the face
    DONE = "done"


class Failure(str, Enum):
    """Every way in which an assembly ends without the peg in; each ends with the peg backed off."""

    NOT_SEEN = "not_seen"  # vision refused
    UNREACHABLE = "unreachable"  # no joint angles inside the limits
    NOT_CONVERGED = "not_converged"  # the attempts are used up
    OVERLOAD = "overload"  # the cell's force or moment cap stopped the arm once too often
    NOT_CALIBRATED = "not_calibrated"  # the F/T calibration was refused
    REFUSED = "refused"  # a service said no to a command
    SERVICE_LOST = "service_lost"  # a service did not answer in time, also when asked again
    ABORTED = "aborted"  # somebody stopped it
    ARM_STOPPED = "arm_stopped"  # the arm broke a motion off by itself: holder, cycles or sensor lost
    DEFECT = "defect"  # an error in the program itself: the detail has its text, the planner's log its trace
    STUCK = "stuck"  # only a withdrawal: the peg is held fast where it sits


class Assemble(Message):
    """Do one assembly from where the arm stands."""

    strategy: AnyStrategy = Strategy.FUSED
    assembly_id: str = ""
    known: PosePrior | None = Field(default=None, description="where the hole is, for the strategy known_pose")


class AbortAssembly(Message):
    """End the running assembly; the peg is backed off."""


class AbortAccepted(Message):
    """Whether an assembly was running."""

    was_running: bool


class PauseAssembly(Message):
    """Hold the running assembly before its next motion, or let it go on. The motion under way is finished."""

    paused: bool = Field(default=True, description="False: go on")


class PauseAccepted(Message):
    """What became of it."""

    was_running: bool = Field(description="False: nothing runs, and the next assembly begins unpaused")
    paused: bool


class AssemblyPhase(Message):
    """A step of the running assembly, in words for people and with its numbers for programs."""

    assembly_id: str
    phase: Phase
    attempt: int = 0
    text: str
    figures: dict[str, float] = Field(default_factory=dict)


class AssemblyResult(Message):
    """How an assembly ended. `pose_base_hole` is T2: where the peg sits now, or the best estimate when it does not."""

    frame: Frame = Frame.BASE
    assembly_id: str
    strategy: AnyStrategy
    inserted: bool
    failure: Failure | None
    failure_detail: str = ""
    backed_off: bool
    pose_base_hole: PoseData | None
    covariance: Covariance6 | None = Field(default=None, description="of T2, as in HoleEstimate; when inserted")
    rank: int | None = Field(
        default=None, description="directions of T2 that the bore's walls hold: 5, or 4 where a round may turn"
    )
    pose_base_peg: PoseData | None
    vision_pose_base_hole: PoseData | None
    warnings: tuple[str, ...] = Field(
        default=(), description="doubts about T2 or vision although the peg is in, with what to look at"
    )
    vision_refused: str = Field(default="", description="why vision did not see the hole: a refusal, its code first")
    felt_for: bool = Field(
        default=False,
        description="the hole was found by force alone although vision was asked: it refused, or its pose was wrong",
    )
    motion_s: float = Field(description="cell clock")
    thinking_s: float = Field(description="wall time of the services between motions")
    touches: int = Field(description="guarded moves that felt something on the way in")
    presses: int = Field(description="presses against the bore's walls once seated, for the exact pose")
    corrections: int
    pushes: int
    peak_force_n: float
    peak_moment_nm: float
    insertion_depth_m: float = Field(description="body past the inner rim, by the final estimate")
    # sums over the motions, as in MotionOutcome; 0 where the driver does not tell
    tip_path_m: float = Field(default=0.0, ge=0.0)
    moving_s: float = Field(default=0.0, ge=0.0)
    jerk_integral_m_s2: float = Field(default=0.0, ge=0.0)
    contact_s: float = Field(default=0.0, ge=0.0)
    contact_impulse_n_s: float = Field(default=0.0, ge=0.0)
    over_20_n_s: float = Field(default=0.0, ge=0.0)


class CalibrateFt(Message):
    """Drive the calibration poses, dwell in each and identify bias, weight and centroid."""

    samples_s: float = Field(default=0.25, gt=0.0, le=5.0)
    temperature_c: float | None = Field(
        default=None,
        ge=-MAX_MAGNITUDE,
        le=MAX_MAGNITUDE,
        description="present temperature of sensor or room; stored with the calibration",
    )


class Withdraw(Message):
    """Take a seated peg straight out along its own axis, slowly and under a force watch."""

    pose_base_hole: PoseData | None = Field(
        default=None, description="the pose from which depth is counted: that of the last assembly, or of the drawing"
    )
    clear_m: float = Field(default=0.03, gt=0.0, le=0.1, description="tip to the hole's face at the end")
    speed_m_s: float = Field(default=0.01, gt=0.0, le=0.05)
    force_limit_n: float = Field(
        default=20.0, gt=0.0, le=MAX_MAGNITUDE, description="a pull above this means that the peg is stuck"
    )


class WithdrawResult(Message):
    """How a withdrawal ended. After `stuck` the arm stands where it felt the limit, its pull let go."""

    withdrawn: bool
    failure: Failure | None
    failure_detail: str = ""
    distance_m: float = Field(description="distance that the peg moved out")
    pose_base_peg: PoseData | None
    motion_s: float = Field(description="cell clock")
    peak_force_n: float
    peak_moment_nm: float
