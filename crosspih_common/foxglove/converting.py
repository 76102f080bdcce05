"""Converts crosspih's messages, in the order in which they came over the bus, to Foxglove's messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame

from crosspih_common.config import Workcell
from crosspih_common.foxglove import schemas
from crosspih_common.foxglove.cameras import calibration_message, rim_annotations
from crosspih_common.foxglove.frames import (
    BASE,
    HOLE,
    HOLE_EXPECTED,
    PEG,
    TRUTH_HOLE,
    TRUTH_PEG,
    ArmFrames,
    Placed,
)
from crosspih_common.foxglove.primitives import pose_message, stamp
from crosspih_common.foxglove.scenes import Scenes
from crosspih_common.foxglove.schemas import ViewerTopic
from crosspih_common.foxglove.wrench_sample import wrench_encoder
from crosspih_common.keys import (
    ADVISE_INSERTION,
    ASSEMBLE,
    CAMERA_CALIBRATION,
    CAPTURE,
    CONTACT_WRENCH,
    ESTIMATE,
    EVENTS,
    FOLLOW,
    JOINT_STATE,
    LOCATE,
    NETWORK,
    PHASE,
    REFUSAL,
    SEATED,
    SEQUENCE_NETWORK,
    TOUCH,
    TRUTH,
    WRENCH_RAW,
    Kind,
    Topic,
)
from crosspih_common.messages import (
    Assemble,
    AssemblyPhase,
    AssemblyResult,
    CameraCalibration,
    CommandRefusal,
    ContactWrench,
    Event,
    FollowTrajectory,
    Frame,
    HoleEstimate,
    InsertionAdvice,
    JointState,
    PoseData,
    PoseErrorEstimate,
    RawWrenchBatch,
    Severity,
    SimulationTruth,
    StereoPair,
    Touch,
)

RATE_HZ = 50.0
FORCE_PERIOD_NS = 40_000_000  # between arrows; the wrenches themselves are published at their own rate
MAX_PATH_POSES = 200
LEVELS = {Severity.INFO: Log.INFO, Severity.WARNING: Log.WARNING, Severity.ERROR: Log.ERROR}
LEFT, RIGHT = Frame.CAMERA_LEFT.value, Frame.CAMERA_RIGHT.value

Publish = Callable[[ViewerTopic, int, bytes], None]


# messages of different topics may arrive out of order, by at most this much
OUT_OF_ORDER_NS = 100_000_000


class FoxgloveTopics:
    """Takes messages of HEARD, and of TRUTH_HEARD in recordings, one thread at a time, and calls
    `publish(topic, stamp, bytes)` with the results. `rate_hz` is the rate of frames, joints and the peg's pose.

    The hole's frame is at the newest estimate; before the first estimate it is at the nominal pose.
    """

    def __init__(self, workcell: Workcell, publish: Publish, rate_hz: float = RATE_HZ) -> None:
        self._workcell, self._publish = workcell, publish
        self._frames, self._scenes = ArmFrames(workcell), Scenes(workcell)
        self._mounting = workcell.sensor_mounting().peg_of_raw
        self._wrench = wrench_encoder(PEG)
        self._period_ns = round(1e9 / rate_hz)
        self._joints_ns = -self._period_ns
        self._arm_told_ns = 0
        self._drawn_ns: dict[ViewerTopic, int] = {}
        self._last: dict[ViewerTopic, bytes] = {}
        self._stamp_ns = 0
        self._begun = False
        self._expected = PoseData.of(workcell.hole_prior.pose_base_hole())
        self._placed, self._truth = Placed(), Placed()
        for frame in (HOLE, HOLE_EXPECTED):
            self._placed.place(frame, BASE, self._expected)
        self._cameras: CameraCalibration | None = None
        self._pictures_ns = 0
        self._touches: list[Touch] = []
        self._true_contacts = False
        take: dict[Topic[Any], Callable[[Any, int], None]] = {
            JOINT_STATE: self._joint_state,
            WRENCH_RAW: self._raw_batch,
            CONTACT_WRENCH: self._contact_wrench,
            CAMERA_CALIBRATION: self._calibration,
            CAPTURE.reply_echo: self._captured,
            LOCATE.reply_echo: self._located,
            ADVISE_INSERTION.reply_echo: self._advised,
            ASSEMBLE.request_echo: self._assembly_begins,
            ASSEMBLE.reply_echo: self._assembled,
            FOLLOW.request_echo: self._planned,
            TOUCH: self._touched,
            PHASE: self._phase,
            EVENTS: self._event,
            REFUSAL: self._refused,
            TRUTH: self._simulated,
        }
        take |= {command.reply_echo: self._estimated for command in (ESTIMATE, SEATED, NETWORK, SEQUENCE_NETWORK)}
        self._take: dict[str, Callable[[Any, int], None]] = {topic.path: method for topic, method in take.items()}

    def wants(self, topic: Topic[Any], stamp_ns: int) -> bool:
        """Whether this message leads to any output; called before it is decoded."""
        if topic.path == JOINT_STATE.path:
            return not 0 <= stamp_ns - self._joints_ns < self._period_ns
        return topic.path in self._take

    def take(self, topic: Topic[Any], value: Any) -> None:
        """One message of a topic."""
        method = self._take.get(topic.path)
        if method is None or not self.wants(topic, value.stamp_ns):
            return
        stamp_ns = max(value.stamp_ns, 0)
        if not self._begun:
            self._begin(stamp_ns)
        self._stamp_ns = stamp_ns
        method(value, stamp_ns)

    def known(self) -> Iterator[tuple[ViewerTopic, bytes]]:
        """Publish the messages that stay valid, for a viewer that connects late or a new file."""
        yield from self._last.items()

    def _tell(self, topic: ViewerTopic, stamp_ns: int, data: bytes) -> None:
        if topic.kind is Kind.STATE:
            self._last[topic] = data
        self._publish(topic, stamp_ns, data)

    def _begin(self, stamp_ns: int) -> None:
        self._begun, self._arm_told_ns = True, stamp_ns
        self._tell_arm(stamp_ns, self._workcell.home_joints_rad)  # first the frames, then the things in them
        self._tell(schemas.ARM, stamp_ns, self._scenes.arm(stamp_ns))
        self._tell(schemas.PLATE, stamp_ns, self._scenes.plate(stamp_ns))
        around = self._scenes.surroundings(stamp_ns)
        if around is not None:
            self._tell(schemas.SURROUNDINGS, stamp_ns, around)

    # ---------------------------------------------------------------------------------------------------- many a second

    def _joint_state(self, state: JointState, stamp_ns: int) -> None:
        if 0 < self._arm_told_ns - stamp_ns < OUT_OF_ORDER_NS:
            return  # a newer message came first; frames do not go back in time
        self._joints_ns = stamp_ns
        self._tell_arm(stamp_ns, state.joints_rad)
        self._tell(schemas.JOINT_STATES, stamp_ns, self._frames.joint_states(state, stamp_ns))

    def _tell_arm(self, stamp_ns: int, joints_rad: tuple[float, ...]) -> None:
        arm, peg = self._frames.transforms(stamp_ns, joints_rad)
        # each message has all frames, so that a viewer can jump in time and interpolates no frame to its next place
        self._tell(schemas.TRANSFORMS, stamp_ns, arm + self._placed.transforms(stamp_ns))
        self._tell(schemas.PEG_POSE, stamp_ns, peg)

    def _raw_batch(self, batch: RawWrenchBatch, stamp_ns: int) -> None:
        loads = (np.asarray(batch.samples) @ self._mounting.T).tolist()
        for index, load in enumerate(loads):
            at_ns = stamp_ns + index * batch.period_ns
            self._publish(schemas.WRENCH_RAW, at_ns, self._wrench(at_ns, load))

    def _contact_wrench(self, felt: ContactWrench, stamp_ns: int) -> None:
        self._publish(schemas.WRENCH_CONTACT, stamp_ns, self._wrench(stamp_ns, felt.wrench))
        if self._due(schemas.FORCE, stamp_ns):
            self._tell(schemas.FORCE, stamp_ns, self._scenes.force(stamp_ns, felt.wrench))

    def _due(self, topic: ViewerTopic, stamp_ns: int) -> bool:
        """Whether arrows are to be drawn again."""
        due = not 0 <= stamp_ns - self._drawn_ns.get(topic, -FORCE_PERIOD_NS) < FORCE_PERIOD_NS
        if due:
            self._drawn_ns[topic] = stamp_ns
        return due

    # --------------------------------------------------------------------------------------------------------- cameras

    def _calibration(self, calibration: CameraCalibration, stamp_ns: int) -> None:
        self._cameras = calibration
        self._placed.place(LEFT, BASE, calibration.pose_base_camera)
        self._placed.place(RIGHT, LEFT, calibration.pose_left_right)
        self._tell(schemas.CALIBRATION_LEFT, stamp_ns, calibration_message(calibration.left, LEFT, stamp_ns))
        self._tell(schemas.CALIBRATION_RIGHT, stamp_ns, calibration_message(calibration.right, RIGHT, stamp_ns))

    def _captured(self, pair: StereoPair, stamp_ns: int) -> None:
        self._pictures_ns = stamp_ns

    def _tell_rims(self, stamp_ns: int) -> None:
        if self._cameras is None:
            return
        pose_left_hole = self._cameras.pose_base_camera.pose().inverse() @ self._placed.poses[HOLE].pose()
        pose_right_hole = self._cameras.pose_left_right.pose().inverse() @ pose_left_hole
        for topic, camera, pose in (
            (schemas.RIM_LEFT, self._cameras.left, pose_left_hole),
            (schemas.RIM_RIGHT, self._cameras.right, pose_right_hole),
        ):
            # under the pictures' own time, by which viewers put annotations on them
            self._tell(topic, stamp_ns, rim_annotations(camera, pose, self._scenes.rims_m, self._pictures_ns))

    # -------------------------------------------------------------------------------------------------------- estimates

    def _believe(self, pose: PoseData, covariance: tuple[float, ...] | None, source: str, stamp_ns: int) -> None:
        self._placed.place(HOLE, BASE, pose)
        self._tell(schemas.HOLE_POSE, stamp_ns, _pose_in_frame(pose, stamp_ns))
        self._tell(schemas.ESTIMATE, stamp_ns, self._scenes.estimate(stamp_ns, covariance, source))

    def _located(self, found: HoleEstimate, stamp_ns: int) -> None:
        self._believe(found.pose_base_hole, found.covariance, f"vision ({found.method.value})", stamp_ns)
        self._tell_rims(stamp_ns)

    def _estimated(self, found: PoseErrorEstimate, stamp_ns: int) -> None:
        self._believe(found.pose_base_hole, found.covariance, f"touch ({found.method})", stamp_ns)

    def _advised(self, advice: InsertionAdvice, stamp_ns: int) -> None:
        self._believe(advice.pose_base_hole, advice.covariance, f"the bore ({advice.contact.value})", stamp_ns)

    def _assembled(self, result: AssemblyResult, stamp_ns: int) -> None:
        if result.pose_base_hole is not None:
            source = "the seated peg (T2)" if result.inserted else "the last estimate"
            self._believe(result.pose_base_hole, result.covariance, source, stamp_ns)
        outcome = "inserted" if result.inserted else f"{result.failure.value if result.failure else 'not inserted'}"
        text = f"{outcome}: {result.failure_detail}" if result.failure_detail else outcome
        level = Log.INFO if result.inserted else Log.WARNING
        self._log("planning", level, f"assembly {result.assembly_id or '-'}: {text}", stamp_ns)

    def _assembly_begins(self, asked: Assemble, stamp_ns: int) -> None:
        self._touches.clear()
        self._tell_touches(stamp_ns)
        self._placed.place(HOLE, BASE, self._expected)
        self._log(
            "planning", Log.INFO, f"assembly {asked.assembly_id or '-'}, strategy {asked.strategy.value}", stamp_ns
        )

    # ------------------------------------------------------------------------------------------------- steps of the way

    def _planned(self, asked: FollowTrajectory, stamp_ns: int) -> None:
        knots = asked.knots[:: 1 + len(asked.knots) // MAX_PATH_POSES]
        tip = np.array([0.0, 0.0, self._scenes.tip_m])
        message = PosesInFrame(timestamp=stamp(stamp_ns), frame_id=BASE)
        for knot in (*knots, asked.knots[-1]):
            pose = self._workcell.pose_base_peg(knot.joints_rad)
            message.poses.append(pose_message(type(pose)(pose.rotation, pose.apply(tip))))
        self._tell(schemas.PLANNED, stamp_ns, message.SerializeToString())

    def _touched(self, touch: Touch, stamp_ns: int) -> None:
        self._touches.append(touch)
        self._tell_touches(stamp_ns)

    def _tell_touches(self, stamp_ns: int) -> None:
        self._tell(schemas.TOUCHES, stamp_ns, self._scenes.touches(stamp_ns, self._touches))
        message = PosesInFrame(timestamp=stamp(stamp_ns), frame_id=BASE)
        message.poses.extend(pose_message(touch.pose_base_peg) for touch in self._touches)
        self._tell(schemas.TOUCHED, stamp_ns, message.SerializeToString())

    def _phase(self, step: AssemblyPhase, stamp_ns: int) -> None:
        figures = ", ".join(f"{name} {value:.4g}" for name, value in step.figures.items())
        text = f"{step.phase.value}: {step.text}" + (f" ({figures})" if figures else "")
        self._log("planning", Log.INFO, text, stamp_ns)

    def _event(self, event: Event, stamp_ns: int) -> None:
        self._log(event.service, LEVELS[event.severity], f"{event.code}: {event.text}", stamp_ns)

    def _refused(self, refusal: CommandRefusal, stamp_ns: int) -> None:
        text = f"{refusal.command} refused: {refusal.refused}: {refusal.text}"
        self._log(refusal.command.partition("/")[0], Log.WARNING, text, stamp_ns)

    def _log(self, name: str, level: int, text: str, stamp_ns: int) -> None:
        message = Log(timestamp=stamp(stamp_ns), level=level, name=name, message=text)  # type: ignore[arg-type]
        self._tell(schemas.LOG, stamp_ns, message.SerializeToString())

    # ----------------------------------------------------------------------------------------------- simulator's truth

    def _simulated(self, truth: SimulationTruth, stamp_ns: int) -> None:
        moved = self._truth.poses.get(TRUTH_HOLE) != truth.pose_base_hole
        self._truth.place(TRUTH_HOLE, BASE, truth.pose_base_hole)
        self._truth.place(TRUTH_PEG, BASE, truth.pose_base_peg)
        self._tell(schemas.TRUTH_TRANSFORMS, stamp_ns, self._truth.transforms(stamp_ns))
        if moved:
            self._tell(schemas.TRUTH_RIM, stamp_ns, self._scenes.true_rim(stamp_ns))
        ended = self._true_contacts and not truth.contacts
        if ended or (truth.contacts and self._due(schemas.TRUTH_CONTACTS, stamp_ns)):
            self._tell(schemas.TRUTH_CONTACTS, stamp_ns, self._scenes.true_contacts(stamp_ns, truth))
        self._true_contacts = bool(truth.contacts)


def _pose_in_frame(pose: PoseData, stamp_ns: int) -> bytes:
    message = PoseInFrame(timestamp=stamp(stamp_ns), frame_id=BASE, pose=pose_message(pose))
    return bytes(message.SerializeToString())


HEARD: tuple[Topic[Any], ...] = (
    JOINT_STATE, WRENCH_RAW, CONTACT_WRENCH, CAMERA_CALIBRATION, CAPTURE.reply_echo, LOCATE.reply_echo,
    ESTIMATE.reply_echo, SEATED.reply_echo, NETWORK.reply_echo, SEQUENCE_NETWORK.reply_echo,
    ADVISE_INSERTION.reply_echo, ASSEMBLE.request_echo, ASSEMBLE.reply_echo, FOLLOW.request_echo, TOUCH, PHASE, EVENTS,
    REFUSAL,
)  # fmt: skip
TRUTH_HEARD: tuple[Topic[Any], ...] = (TRUTH,)
