"""The cell's ROS 2 topics and their contents, for the bridge and for recordings exported as bags."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Literal, Protocol

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import (
    AssemblyResult,
    CameraCalibration,
    CellClock,
    ContactWrench,
    Event,
    Frame,
    HoleEstimate,
    Image,
    JointState,
    PoseData,
    RawWrenchBatch,
    ServiceStatus,
)
from crosspih_common.ros2.converting import Converter
from crosspih_common.ros2.frames import RosArm
from crosspih_common.ros2.qos import RosQos
from crosspih_common.ros2.stamps import WallOfCell
from crosspih_common.ros2.types import RosTypes

STREAM, LATCHED = RosQos(depth=10), RosQos(transient_local=True, depth=1)
TF = RosQos(depth=100)  # tf2_ros::DynamicBroadcasterQoS; LATCHED is its StaticBroadcasterQoS
SILENT_NS = 3_000_000_000  # a service publishes its status once a second
CAMERA_FRAMES = (Frame.CAMERA_LEFT.value, Frame.CAMERA_RIGHT.value)
INFO, IMAGE = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/Image"


class Sink(Protocol):
    """Takes the messages of one topic."""

    def publish(self, message: Any) -> None:
        """The next one."""


class Publishers(Protocol):
    """Where topics are published: a node, or a bag."""

    types: RosTypes

    def publisher(self, name: str, ros_type: str, qos: RosQos) -> Sink:
        """Begin a topic."""


class Topics:
    """Every topic of the cell. The methods may be called on several threads, one a kind."""

    def __init__(
        self, publishers: Publishers, arm: RosArm, workcell: Workcell, now_ns: Callable[[], int], *,
        stamps: Literal["wall", "cell"] = "wall", tf_hz: float = 50.0, has: frozenset[str] = frozenset(),
    ) -> None:  # fmt: skip
        """`now_ns` is the wall clock; `has` are the devices that come from ROS: they are not published again."""
        self._arm, self._frames, self._now_ns = arm, arm.frames, now_ns
        self._stamps, self._tf_hz = stamps, tf_hz
        self._mounting = workcell.sensor_mounting()
        self._convert = Converter(publishers.types)
        self._clock = WallOfCell()
        self._lock = threading.Lock()
        self._static: dict[str, tuple[str, Pose]] = {}  # child: parent and pose_parent_child
        self._calibration: CameraCalibration | None = None
        self._statuses: dict[str, tuple[int, ServiceStatus]] = {}
        self._events: list[Event] = []
        self._next_tf_ns = 0
        publish = publishers.publisher
        if "arm" not in has:
            self._joint_states = publish("joint_states", "sensor_msgs/msg/JointState", STREAM)
            self._tf = publish("/tf", "tf2_msgs/msg/TFMessage", TF)
            self._description = publish("robot_description", "std_msgs/msg/String", LATCHED)
            self._description.publish(self._convert.string(arm.urdf))
        self._tf_static = publish("/tf_static", "tf2_msgs/msg/TFMessage", LATCHED)
        self._wrench = publish("wrench", "geometry_msgs/msg/WrenchStamped", STREAM)
        self._wrench_raw = publish("wrench_raw", "geometry_msgs/msg/WrenchStamped", STREAM)
        self._hole_pose = publish("hole_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", LATCHED)
        self._assembled = publish("assembled_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", LATCHED)
        if "camera" not in has:
            self._images = tuple(publish(f"camera/{side}/image_raw", IMAGE, LATCHED) for side in ("left", "right"))
            self._infos = tuple(publish(f"camera/{side}/camera_info", INFO, LATCHED) for side in ("left", "right"))
        self._diagnostics = publish("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", STREAM)
        self._place(Frame.PEG.value, self._frames.flange, workcell.pose_flange_peg(), now_ns())

    def _stamp_ns(self, stamp_ns: int) -> int:
        if self._stamps == "cell":
            return stamp_ns
        mapped_ns = self._clock.wall_ns(stamp_ns)
        return self._now_ns() if mapped_ns is None else mapped_ns

    def clock(self, tick: CellClock) -> None:
        """The cell's time."""
        self._clock.observe(tick.stamp_ns, self._now_ns(), tick.boot_id)

    def joint_state(self, state: JointState) -> None:
        """/joint_states, and the arm's links on /tf."""
        stamp_ns = self._stamp_ns(state.stamp_ns)
        names = self._arm.chain.joint_names
        self._joint_states.publish(self._convert.joint_state(names, state, stamp_ns, self._frames.base))
        if self._tf_hz and not 0 < self._next_tf_ns - state.stamp_ns < 1e9:
            self._next_tf_ns = state.stamp_ns + round(1e9 / self._tf_hz)
            self._tf.publish(self._convert.arm_tf(self._arm, state.joints_rad, stamp_ns))

    def contact_wrench(self, wrench: ContactWrench) -> None:
        """/wrench: contact alone."""
        frame = self._frames.of(wrench.frame.value)
        self._wrench.publish(self._convert.wrench(wrench.wrench, frame, self._stamp_ns(wrench.stamp_ns)))

    def raw_batch(self, batch: RawWrenchBatch) -> None:
        """/wrench_raw: every sample of the sensor as a load on the peg, bias and weight included."""
        for index, sample in enumerate(batch.samples):
            on_peg = (self._mounting.peg_of_raw @ sample).tolist()
            stamp_ns = self._stamp_ns(batch.stamp_ns + index * batch.period_ns)
            self._wrench_raw.publish(self._convert.wrench(on_peg, Frame.PEG.value, stamp_ns))

    def hole(self, found: HoleEstimate) -> None:
        """/hole_pose as vision sees it, and the frame `hole`."""
        stamp_ns, pose = self._stamp_ns(found.stamp_ns), found.pose_base_hole.pose()
        posed = self._convert.pose_with_covariance(pose, found.covariance, self._frames.base, stamp_ns)
        self._hole_pose.publish(posed)
        self._place(Frame.HOLE.value, self._frames.base, pose, stamp_ns)

    def assembled(self, result: AssemblyResult) -> None:
        """/assembled_pose and the frame `hole`: the hole's pose measured with the seated peg (T2)."""
        if not result.inserted or result.pose_base_hole is None:
            return
        stamp_ns, pose = self._stamp_ns(result.stamp_ns), result.pose_base_hole.pose()
        covariance = result.covariance or (0.0,) * 36  # all zero is ROS's "not known"
        self._assembled.publish(self._convert.pose_with_covariance(pose, covariance, self._frames.base, stamp_ns))
        self._place(Frame.HOLE.value, self._frames.base, pose, stamp_ns)

    def calibration(self, calibration: CameraCalibration) -> None:
        """/camera/*/camera_info and where the cameras stand."""
        stamp_ns = self._stamp_ns(calibration.stamp_ns)
        with self._lock:
            self._calibration = calibration
        self._tell_cameras(calibration, stamp_ns)
        left, right = CAMERA_FRAMES
        self._place(right, left, calibration.pose_left_right.pose(), stamp_ns)
        self._place(left, self._frames.base, calibration.pose_base_camera.pose(), stamp_ns)

    def left_image(self, image: Image) -> None:
        """/camera/left/image_raw."""
        self._image(0, image)

    def right_image(self, image: Image) -> None:
        """/camera/right/image_raw, and both camera_infos with the pictures' stamp."""
        self._image(1, image)
        with self._lock:
            calibration = self._calibration
        if calibration is not None:
            self._tell_cameras(calibration, self._stamp_ns(image.stamp_ns))

    def _image(self, index: int, image: Image) -> None:
        self._images[index].publish(self._convert.image(image, self._stamp_ns(image.stamp_ns)))

    def _tell_cameras(self, calibration: CameraCalibration, stamp_ns: int) -> None:
        infos = self._convert.camera_infos(calibration, CAMERA_FRAMES, stamp_ns)
        for publisher, info in zip(self._infos, infos, strict=True):
            publisher.publish(info)

    def _place(self, child: str, parent: str, pose_parent_child: Pose, stamp_ns: int) -> None:
        with self._lock:
            told = self._static.get(child)
            if told is not None and PoseData.of(told[1]) == PoseData.of(pose_parent_child):
                return
            self._static[child] = parent, pose_parent_child
            transforms = [
                self._convert.transform(above, below, pose, stamp_ns) for below, (above, pose) in self._static.items()
            ]
        self._tf_static.publish(self._convert.tf(transforms))

    def status(self, status: ServiceStatus) -> None:
        """Take a service's status."""
        with self._lock:
            self._statuses[status.service] = self._now_ns(), status

    def event(self, event: Event) -> None:
        """Take an event."""
        with self._lock:
            self._events.append(event)

    def diagnose(self) -> None:
        """/diagnostics: once a second."""
        now_ns = self._now_ns()
        with self._lock:
            heard, events = dict(self._statuses), self._events
            self._events = []
        living = [status for at, status in heard.values() if now_ns - at <= SILENT_NS]
        silent = [name for name, (at, _) in heard.items() if now_ns - at > SILENT_NS]
        self._diagnostics.publish(self._convert.diagnostics(living, events, silent, now_ns))
