"""The key space: one table of every key below `crosspih/<cell>/`, from which recorder, CLI, docs and rules derive.

No other module writes out a key. Each row gives the message type, sender, readers, rate and quality of service. A
command `c` is a query on key `c`; its server repeats the request on `c/request` and the reply on `c/reply`, so that a
recording holds both.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

# handed on: who uses a key says of what kind it is
from crosspih_common.key_types import RECORDED as RECORDED
from crosspih_common.key_types import ROOT as ROOT
from crosspih_common.key_types import SHOWN as SHOWN
from crosspih_common.key_types import Command as Command
from crosspih_common.key_types import Kind as Kind
from crosspih_common.key_types import Payload as Payload
from crosspih_common.key_types import PayloadT as PayloadT
from crosspih_common.key_types import Qos as Qos
from crosspih_common.key_types import ReplyT as ReplyT
from crosspih_common.key_types import RequestT as RequestT
from crosspih_common.key_types import Topic as Topic
from crosspih_common.messages import (
    AbortAccepted,
    AbortAssembly,
    AdmittanceMove,
    AdviseInsertion,
    AskWallClock,
    Assemble,
    AssemblyPhase,
    AssemblyResult,
    CalibrateFt,
    CameraCalibration,
    CaptureStereo,
    CellClock,
    ClassifyContacts,
    CommandRefusal,
    CompensateWrench,
    ContactReading,
    ContactState,
    ContactStates,
    ContactWrench,
    Dwell,
    EstimateByNetwork,
    EstimateBySequence,
    EstimatePose,
    EstimateSeated,
    Event,
    FollowTrajectory,
    FtCalibration,
    GiveLease,
    GuardedMove,
    GuardedMoveOutcome,
    HoleEstimate,
    IdentifyPayload,
    Image,
    InsertionAdvice,
    JointState,
    LeaseBeat,
    LeaseGiven,
    LeaseGranted,
    LeaseState,
    LocateHole,
    MotionOutcome,
    MoveLinear,
    NextTouch,
    PauseAccepted,
    PauseAssembly,
    PayloadAccepted,
    PoseErrorEstimate,
    RawWrenchBatch,
    RecordingStatus,
    ResetCell,
    ServiceStatus,
    SetPayload,
    SimulationTruth,
    StartRecording,
    StereoPair,
    StopAccepted,
    StopMotion,
    StopRecording,
    TakeLease,
    Touch,
    TouchPlan,
    WallClock,
    Withdraw,
    WithdrawResult,
)

ALL = (
    "hardware",
    "vision",
    "force_torque",
    "inference",
    "planning",
    "recorder",
    "operator",
    "ros2",
    "foxglove",
    "viewer",
)

# hardware -------------------------------------------------------------------------------------------------------------
CLOCK = Topic("clock", CellClock, Kind.STATE, "hardware", ALL, "the cell's clock", 50.0)
WALL_CLOCK = Command(
    "clock/wall",
    AskWallClock,
    WallClock,
    "hardware",
    tuple(name for name in ALL if name != "hardware"),
    "how far is a machine's wall clock off",
)
JOINT_STATE = Topic(
    "arm/joint_state",
    JointState,
    Kind.STREAM,
    "hardware",
    ("force_torque", "planning", "operator", "ros2", "foxglove", "viewer", *RECORDED),
    "the encoders",
    250.0,
)
WRENCH_RAW = Topic(
    "ft/raw",
    RawWrenchBatch,
    Kind.STREAM,
    "hardware",
    ("force_torque", "planning", "operator", "ros2", "foxglove", *RECORDED),
    "the sensor",
    100.0,
)
CAMERA_CALIBRATION = Topic(
    "camera/calibration",
    CameraCalibration,
    Kind.STATE,
    "hardware",
    ("operator", "ros2", "foxglove", "viewer", *RECORDED),
    "what the cameras are",
)
IMAGE_LEFT = Topic(
    "camera/left/image",
    Image,
    Kind.EVENT,
    "hardware",
    ("vision", "operator", "ros2", "foxglove", "viewer", *RECORDED),
    "left picture",
)
IMAGE_RIGHT = Topic(
    "camera/right/image",
    Image,
    Kind.EVENT,
    "hardware",
    ("vision", "operator", "ros2", "foxglove", "viewer", *RECORDED),
    "right picture",
)
TRUTH = Topic(
    "simulation/truth",
    SimulationTruth,
    Kind.STATE,
    "hardware",
    ("operator", *RECORDED),
    "what only the simulator knows: for scoring",
)
FOLLOW = Command(
    "arm/follow", FollowTrajectory, MotionOutcome, "hardware", ("planning", "operator"), "follow a joint trajectory"
)
MOVE_LINEAR = Command(
    "arm/move_linear", MoveLinear, MotionOutcome, "hardware", ("planning", "operator"), "move the peg on a line"
)
GUARDED_MOVE = Command(
    "arm/guarded_move", GuardedMove, GuardedMoveOutcome, "hardware", ("planning", "operator"), "move until it touches"
)
ADMITTANCE_MOVE = Command(
    "arm/admittance_move", AdmittanceMove, MotionOutcome, "hardware", ("planning", "operator"), "push in, yielding"
)
DWELL = Command("arm/dwell", Dwell, MotionOutcome, "hardware", ("planning", "operator"), "hold still and average")
STOP = Command("arm/stop", StopMotion, StopAccepted, "hardware", ("planning", "operator"), "end whatever moves")
SET_PAYLOAD = Command(
    "arm/set_payload",
    SetPayload,
    PayloadAccepted,
    "hardware",
    ("planning", "operator"),
    "what hangs on the sensor",
    changes_calibration=True,
)
LEASE_TAKE = Command(
    "arm/lease/take", TakeLease, LeaseGranted, "hardware", ("planning", "operator"), "hold the arm: motion needs it"
)
LEASE_GIVE = Command("arm/lease/give", GiveLease, LeaseGiven, "hardware", ("planning", "operator"), "let go of the arm")
LEASE_BEAT = Topic(
    "arm/lease/beat/{service}",
    LeaseBeat,
    Kind.STREAM,
    "{service}",
    ("hardware", "operator", *RECORDED),
    "the holder lives",
    50.0,
)
LEASE = Topic(
    "arm/lease", LeaseState, Kind.STATE, "hardware", ("planning", "operator", "viewer", *RECORDED), "who holds the arm"
)
CAPTURE = Command("camera/capture", CaptureStereo, StereoPair, "hardware", ("vision", "operator"), "take a pair")
RESET = Command("simulation/reset", ResetCell, SimulationTruth, "hardware", ("operator", "viewer"), "start a new trial")

# vision ---------------------------------------------------------------------------------------------------------------
LOCATE = Command("vision/locate", LocateHole, HoleEstimate, "vision", ("planning", "operator"), "where is the hole")
ANNOTATED_LEFT = Topic(
    "vision/annotated/left",
    Image,
    Kind.EVENT,
    "vision",
    ("foxglove", "viewer", *SHOWN),
    "left picture with what vision saw",
)
ANNOTATED_RIGHT = Topic(
    "vision/annotated/right",
    Image,
    Kind.EVENT,
    "vision",
    ("foxglove", "viewer", *SHOWN),
    "right picture with what vision saw",
)

# force_torque ---------------------------------------------------------------------------------------------------------
CONTACT_WRENCH = Topic(
    "force_torque/wrench",
    ContactWrench,
    Kind.STREAM,
    "force_torque",
    ("ros2", "foxglove", "viewer", *SHOWN),
    "contact alone",
    100.0,
)
CONTACT_STATE = Topic(
    "force_torque/state",
    ContactState,
    Kind.STREAM,
    "force_torque",
    ("foxglove", "viewer", *SHOWN),
    "one of the 26",
    10.0,
)
FT_CALIBRATION = Topic(
    "force_torque/calibration",
    FtCalibration,
    Kind.STATE,
    "force_torque",
    ("planning", "operator", *RECORDED),
    "bias and payload",
)
IDENTIFY_PAYLOAD = Command(
    "force_torque/identify",
    IdentifyPayload,
    FtCalibration,
    "force_torque",
    ("planning",),
    "Eqs. 14-16",
    changes_calibration=True,
)
COMPENSATE = Command(
    "force_torque/compensate",
    CompensateWrench,
    ContactReading,
    "force_torque",
    ("planning", "operator"),
    "raw to contact wrench",
)
CLASSIFY = Command(
    "force_torque/classify", ClassifyContacts, ContactStates, "force_torque", ("operator",), "wrenches to states"
)

# inference ------------------------------------------------------------------------------------------------------------
ESTIMATE = Command("inference/estimate", EstimatePose, PoseErrorEstimate, "inference", ("planning",), "touches to pose")
NEXT_TOUCH = Command("inference/next_touch", NextTouch, TouchPlan, "inference", ("planning",), "where to push next")
SEATED = Command(
    "inference/seated", EstimateSeated, PoseErrorEstimate, "inference", ("planning",), "seated peg to pose"
)
NETWORK = Command(
    "inference/network", EstimateByNetwork, PoseErrorEstimate, "inference", ("planning",), "the paper's way"
)
SEQUENCE_NETWORK = Command(
    "inference/sequence_network",
    EstimateBySequence,
    PoseErrorEstimate,
    "inference",
    ("planning",),
    "touches to pose, learned",
)

ADVISE_INSERTION = Command(
    "inference/advise_insertion", AdviseInsertion, InsertionAdvice, "inference", ("planning",), "a stall"
)

# planning -------------------------------------------------------------------------------------------------------------
ASSEMBLE = Command(
    "planning/assemble", Assemble, AssemblyResult, "planning", ("operator", "ros2", "viewer"), "one assembly"
)
ABORT = Command(
    "planning/abort", AbortAssembly, AbortAccepted, "planning", ("operator", "ros2", "viewer"), "end it, peg backed off"
)
PAUSE = Command(
    "planning/pause",
    PauseAssembly,
    PauseAccepted,
    "planning",
    ("operator", "viewer"),
    "hold before the next motion, or go on",
)
CALIBRATE_FT = Command(
    "planning/calibrate_ft",
    CalibrateFt,
    FtCalibration,
    "planning",
    ("operator",),
    "drive the poses and identify",
    changes_calibration=True,
)
WITHDRAW = Command(
    "planning/withdraw",
    Withdraw,
    WithdrawResult,
    "planning",
    ("operator", "ros2", "viewer"),
    "a seated peg straight out",
)
PHASE = Topic(
    "planning/phase",
    AssemblyPhase,
    Kind.EVENT,
    "planning",
    ("operator", "ros2", "foxglove", "viewer", *RECORDED),
    "each step as it happens",
)
TOUCH = Topic(
    "planning/touch", Touch, Kind.EVENT, "planning", ("operator", "foxglove", "viewer", *RECORDED), "each touch"
)

# recorder -------------------------------------------------------------------------------------------------------------
RECORD_START = Command(
    "recorder/start", StartRecording, RecordingStatus, "recorder", ("operator", "viewer"), "begin a file"
)
RECORD_STOP = Command(
    "recorder/stop", StopRecording, RecordingStatus, "recorder", ("operator", "viewer"), "finish the file"
)

# every service --------------------------------------------------------------------------------------------------------
STATUS = Topic(
    "service/{service}/status", ServiceStatus, Kind.STREAM, "{service}",
    ("operator", "ros2", "foxglove", "viewer", *RECORDED),
    "how it is", 1.0,
)  # fmt: skip
EVENTS = Topic(
    "service/{service}/event",
    Event,
    Kind.EVENT,
    "{service}",
    ("operator", "ros2", "foxglove", "viewer", *RECORDED),
    "what people should know",
)
REFUSAL = Topic(
    "service/{service}/refusal",
    CommandRefusal,
    Kind.EVENT,
    "{service}",
    ("operator", "foxglove", *RECORDED),
    "a command that was refused, and why",
)
ALIVE_PATH = "service/{service}/alive"  # a liveliness token, no samples
AUTHOR_PATH = "service/{service}/author/{process}/{session}"  # a liveliness token too: who speaks for the service
CAMERA_ALIVE = "camera"  # the service name in the token of the process that serves the camera's keys


def commands() -> Iterator[Command[Any, Any]]:
    """Every command of the table."""
    return (value for value in globals().values() if isinstance(value, Command))


def topics() -> Iterator[Topic[Any]]:
    """Every topic of the table, the commands' echoes included."""
    yield from (value for value in globals().values() if isinstance(value, Topic))
    for command in commands():
        yield command.request_echo
        yield command.reply_echo


def alive_key(cell: str, service: str = "*") -> str:
    """The liveliness key of a service, or the expression for all."""
    return f"{ROOT}/{cell}/{ALIVE_PATH.format(service=service)}"


def author_key(cell: str, service: str = "*", process: str = "*", session: str = "*") -> str:
    """The liveliness key by which a session of a process claims a service's name, or the expression for all."""
    return f"{ROOT}/{cell}/{AUTHOR_PATH.format(service=service, process=process, session=session)}"


def router_key(session: str) -> str:
    """The key on which a router that is linked to others shows that it is present, by its session's name."""
    return f"{ROOT}/routers/{session}"
