"""Converts our messages to ROS 2's, for the bridge and for export as bags. Stamps are ns of the caller's clock."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array, Pose
from crosspih_common.messages import (
    CameraCalibration,
    Event,
    Image,
    JointState,
    ServiceState,
    ServiceStatus,
    Severity,
)
from crosspih_common.messages.images import ENCODINGS
from crosspih_common.ros2.frames import RosArm
from crosspih_common.ros2.stereo import CameraInfo, camera_infos
from crosspih_common.ros2.types import RosTypes

SECOND_NS = 1_000_000_000
OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs/DiagnosticStatus
LEVELS = {Severity.INFO: OK, Severity.WARNING: WARN, Severity.ERROR: ERROR}


class Converter:
    """Makes ROS 2 messages of one distribution."""

    def __init__(self, types: RosTypes) -> None:
        self._make = types.make

    def time(self, stamp_ns: int) -> Any:
        """builtin_interfaces/Time."""
        return self._make("builtin_interfaces/msg/Time", sec=stamp_ns // SECOND_NS, nanosec=stamp_ns % SECOND_NS)

    def header(self, stamp_ns: int, frame: str) -> Any:
        """std_msgs/Header."""
        return self._make("std_msgs/msg/Header", stamp=self.time(stamp_ns), frame_id=frame)

    def string(self, text: str) -> Any:
        """std_msgs/String."""
        return self._make("std_msgs/msg/String", data=text)

    def joint_state(self, names: Sequence[str], state: JointState, stamp_ns: int, frame: str) -> Any:
        """sensor_msgs/JointState from the encoders. Efforts stay empty."""
        return self._make(
            "sensor_msgs/msg/JointState", header=self.header(stamp_ns, frame), name=list(names),
            position=np.array(state.joints_rad), velocity=np.array(state.speeds_rad_s), effort=np.zeros(0),
        )  # fmt: skip

    def _vector(self, values: ArrayLike, name: str = "geometry_msgs/msg/Vector3") -> Any:
        x, y, z = np.asarray(values, float).tolist()
        return self._make(name, x=x, y=y, z=z)

    def _quaternion(self, pose: Pose) -> Any:
        x, y, z, w = pose.quaternion_xyzw().tolist()
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def transform(self, parent: str, child: str, pose_parent_child: Pose, stamp_ns: int) -> Any:
        """geometry_msgs/TransformStamped."""
        pose = self._make(
            "geometry_msgs/msg/Transform",
            translation=self._vector(pose_parent_child.translation_m), rotation=self._quaternion(pose_parent_child),
        )  # fmt: skip
        return self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp_ns, parent), child_frame_id=child, transform=pose,
        )  # fmt: skip

    def tf(self, transforms: Iterable[Any]) -> Any:
        """tf2_msgs/TFMessage."""
        return self._make("tf2_msgs/msg/TFMessage", transforms=list(transforms))

    def arm_tf(self, arm: RosArm, joints_rad: Sequence[float], stamp_ns: int) -> Any:
        """tf2_msgs/TFMessage: every link of the arm, base first."""
        poses = arm.chain.poses(joints_rad)
        joints = arm.chain.joints
        return self.tf(
            self.transform(joint.parent, joint.child, pose, stamp_ns) for joint, pose in zip(joints, poses, strict=True)
        )

    def wrench(self, wrench: Sequence[float], frame: str, stamp_ns: int) -> Any:
        """geometry_msgs/WrenchStamped of a wrench (6,), N and Nm, in `frame` about its origin."""
        return self._make(
            "geometry_msgs/msg/WrenchStamped", header=self.header(stamp_ns, frame),
            wrench=self._make(
                "geometry_msgs/msg/Wrench", force=self._vector(wrench[:3]), torque=self._vector(wrench[3:])
            ),
        )  # fmt: skip

    def _pose(self, pose: Pose) -> Any:
        return self._make(
            "geometry_msgs/msg/Pose",
            position=self._vector(pose.translation_m, "geometry_msgs/msg/Point"), orientation=self._quaternion(pose),
        )  # fmt: skip

    def pose_stamped(self, pose: Pose, frame: str, stamp_ns: int) -> Any:
        """geometry_msgs/PoseStamped of a pose in `frame`."""
        return self._make("geometry_msgs/msg/PoseStamped", header=self.header(stamp_ns, frame), pose=self._pose(pose))

    def pose_with_covariance(self, pose: Pose, covariance: Sequence[float], frame: str, stamp_ns: int) -> Any:
        """geometry_msgs/PoseWithCovarianceStamped of a pose in `frame` with its covariance (36,) in its own frame."""
        return self._make(
            "geometry_msgs/msg/PoseWithCovarianceStamped", header=self.header(stamp_ns, frame),
            pose=self._make(
                "geometry_msgs/msg/PoseWithCovariance", pose=self._pose(pose),
                covariance=covariance_in_parent(pose, covariance).ravel(),
            ),
        )  # fmt: skip

    def image(self, image: Image, stamp_ns: int) -> Any:
        """sensor_msgs/Image; 16 bits go little-endian."""
        kind, channels = ENCODINGS[image.encoding]
        height, width = image.pixels.shape[:2]
        data = np.ascontiguousarray(image.pixels.astype(np.dtype(kind).newbyteorder("<"), copy=False)).view(np.uint8)
        return self._make(
            "sensor_msgs/msg/Image", header=self.header(stamp_ns, image.frame), height=height, width=width,
            encoding=image.encoding.removesuffix("be"), is_bigendian=0, step=width * channels * int(kind[-1]),
            data=data.ravel(),
        )  # fmt: skip

    def camera_infos(self, calibration: CameraCalibration, frames: tuple[str, str], stamp_ns: int) -> tuple[Any, Any]:
        """sensor_msgs/CameraInfo of the left and of the right camera."""
        left, right = camera_infos(calibration)
        return self._camera_info(left, frames[0], stamp_ns), self._camera_info(right, frames[1], stamp_ns)

    def _camera_info(self, info: CameraInfo, frame: str, stamp_ns: int) -> Any:
        roi = self._make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self._make(
            "sensor_msgs/msg/CameraInfo", header=self.header(stamp_ns, frame), height=info.height, width=info.width,
            distortion_model=info.model, d=info.d, k=info.k.ravel(), r=info.r.ravel(), p=info.p.ravel(),
            binning_x=0, binning_y=0, roi=roi,
        )  # fmt: skip

    def diagnostics(
        self, statuses: Iterable[ServiceStatus], events: Iterable[Event], silent: Iterable[str], stamp_ns: int
    ) -> Any:
        """diagnostic_msgs/DiagnosticArray: one status per service, one per silent service, and the new events."""
        lines = [self._status(status) for status in statuses]
        lines += [self._line(name, ERROR, "says nothing any more", {}) for name in silent]
        lines += [
            self._line(f"{event.service}: {event.code}", LEVELS[event.severity], event.text, {}) for event in events
        ]
        return self._make("diagnostic_msgs/msg/DiagnosticArray", header=self.header(stamp_ns, ""), status=lines)

    def _status(self, status: ServiceStatus) -> Any:
        failed, doubt = status.state is ServiceState.FAILED, status.rejected or status.dropped
        values = {
            "state": status.state.value, "pid": str(status.pid), "uptime_s": f"{status.uptime_s:g}",
            "rejected": str(status.rejected), "dropped": str(status.dropped), "last_error": status.last_error,
            "last_error_age_s": "" if status.last_error_age_s is None else f"{status.last_error_age_s:g}",
        }  # fmt: skip
        text = status.reason or status.state.value
        return self._line(status.service, ERROR if failed else WARN if doubt else OK, text, values)

    def _line(self, name: str, level: int, text: str, values: dict[str, str]) -> Any:
        return self._make(
            "diagnostic_msgs/msg/DiagnosticStatus", level=level, name=f"crosspih: {name}", message=text,
            hardware_id="crosspih",
            values=[self._make("diagnostic_msgs/msg/KeyValue", key=key, value=said) for key, said in values.items()],
        )  # fmt: skip


def covariance_in_parent(pose: Pose, covariance: Sequence[float]) -> Array:
    """A pose's covariance (36,), in its own frame, as (6, 6) about the axes of its parent, as ROS wants it."""
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = pose.rotation
    return np.asarray(turn @ np.asarray(covariance, float).reshape(6, 6) @ turn.T)
