"""Opens the ROS 2 devices of a cell: each is looked for, listened to and checked before anything else starts."""

from __future__ import annotations

import sys

from crosspih_common.arm.description import default_joint_names
from crosspih_common.errors import ConfigError
from crosspih_common.ros2.frames import ros_arm
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.ros2.camera import RosCamera
from services.hardware.drivers.ros2.config import Ros2Config
from services.hardware.drivers.ros2.joints import FIELD, RosJoints, describe
from services.hardware.drivers.ros2.samples import RosTime
from services.hardware.drivers.ros2.wrench import RosWrench
from services.hardware.protocols import Devices


def open_devices(request: OpenRequest) -> Devices:
    """The devices of `hardware.ros2`. Raises ConfigError, BusUnreachable."""
    config = request.config.ros2 or Ros2Config()
    names = joint_names(request, config) if "arm" in request.wanted else ()
    node = config.open("hardware.ros2", config.node)
    try:
        ros_time = RosTime(config.stamps)
        devices = Devices(realtime=True, close=node.close)
        if "arm" in request.wanted:
            joints = RosJoints(node, config, ros_time, request.workcell.arm(), names)
            devices.joints = joints
            _say(describe(joints, config.arm))
        if "force_torque" in request.wanted:
            wrench = RosWrench(node, config, ros_time)
            devices.wrench = wrench
            _say(f"force/torque: {config.force_torque.topic} at {wrench.rate_hz:.0f} Hz, frame {wrench.frame_id!r}")
        if "camera" in request.wanted:
            devices.camera = RosCamera(node, config, ros_time, request.workcell)
            _say(f"cameras: {config.camera.left} and {config.camera.right}")
    except BaseException:
        node.close()
        raise
    return devices


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def joint_names(request: OpenRequest, config: Ros2Config) -> tuple[str, ...]:
    """The names by which the joint states tell the arm's joints. Raises ConfigError."""
    workcell, given = request.workcell, config.arm.joint_names
    if given is None:
        if workcell.arm_section.urdf is not None:
            return ros_arm(workcell, FIELD).chain.joint_names
        return default_joint_names(workcell.arm())
    if len(given) != workcell.arm().joints or len(set(given)) != len(given):
        raise ConfigError(f"{FIELD}.joint_names: {len(given)} names, want {workcell.arm().joints} that differ")
    return given
