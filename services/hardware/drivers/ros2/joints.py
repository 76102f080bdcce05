"""An arm under ros2_control: joint states come, set-points go, one of each a cycle of the controller_manager."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosspih_common.arm import ArmModel
from crosspih_common.errors import ConfigError, DeviceLost
from crosspih_common.geometry.pose import Array
from crosspih_common.ros2 import Entity, RosNode, RosQos
from services.hardware.drivers.ros2.config import ArmTopics, Ros2Config
from services.hardware.drivers.ros2.samples import RosTime, TopicSamples, require_one_publisher
from services.hardware.protocols import JointReading

FIELD = "hardware.ros2.arm"
JOINT_STATE = "sensor_msgs/msg/JointState"
POSITIONS, TRAJECTORY = "std_msgs/msg/Float64MultiArray", "trajectory_msgs/msg/JointTrajectory"
COMMANDS = {
    "positions": ("/forward_position_controller/commands", POSITIONS),
    "trajectory": ("/joint_trajectory_controller/joint_trajectory", TRAJECTORY),
}
CLOCK_BACK_NS = 1_000_000_000
SLACK_RAD = 0.01  # encoders may say a little more than the limit


class RosJoints:
    """Implements JointDevice. `read` is paced by the joint states; `write` sends the next set-point at once."""

    def __init__(
        self, node: RosNode, config: Ros2Config, ros_time: RosTime, model: ArmModel, names: tuple[str, ...]
    ) -> None:
        """Raises ConfigError where the arm is not there, or is another than the cell's file says."""
        self.model, self._config, self._names = model, config.arm, names
        self._time = ros_time
        self._types = node.types
        self._heard = TopicSamples(node, config.arm.joint_states, JOINT_STATE, f"{FIELD}.joint_states", RosQos(), 4)
        self._seen = 0
        self._order: tuple[list[str], NDArray[np.intp]] | None = None
        first = self._first(config.connect_s)
        require_one_publisher(node, config.arm.joint_states, f"{FIELD}.joint_states")
        self.period_s = 1.0 / self._heard.rate_hz(ros_time, config.arm.rate_hz)
        if not 0.0009 <= self.period_s <= 0.021:
            raise ConfigError(f"{FIELD}.joint_states: come at {1.0 / self.period_s:.0f} Hz, want 50 to 1000")
        if lines := model.limits.violations(first, SLACK_RAD):
            raise ConfigError(f"{FIELD}.joint_names: {'; '.join(lines)}: another arm or another order of joints?")
        default, kind = COMMANDS[config.arm.interface]
        self.command_topic = config.arm.commands or default
        self._lead_s = config.arm.lead_s or 2.0 * self.period_s
        self._publisher = node.publisher(self.command_topic, kind)
        self._require_listener(node, kind)
        self._last_ns = -1
        self._lock = threading.Lock()
        self._measured = first
        self._away = True  # until what is to be sent is near to where the arm is
        self._sent: Array | None = None

    def _first(self, connect_s: float) -> Array:
        positions = self._positions(self._heard.first(connect_s))
        if positions is None:
            found = ", ".join(self._heard.first(connect_s).name)
            raise ConfigError(f"{FIELD}.joint_names: {', '.join(self._names)} wanted, {self._heard.name} has {found}")
        return positions

    def _require_listener(self, node: RosNode, kind: str) -> None:
        there = node.graph(Entity.SUBSCRIBER)
        mine = [one for one in there if one.name == self._publisher.endpoint.name]
        if not mine:
            near = sorted({one.name for one in there if one.ros_type == kind}) or ["none"]
            raise ConfigError(
                f"{FIELD}.commands: nobody listens to {self.command_topic}; is the controller loaded and active (ros2 "
                f"control list_controllers)? Those that take {kind}: {', '.join(near)}"
            )
        if mine[0].type_hash != self._publisher.endpoint.type_hash:
            raise ConfigError(
                f"{FIELD}.commands: {mine[0].node} takes {mine[0].ros_type} of another definition; set "
                "hardware.ros2.distro, or hardware.ros2.arm.interface"
            )

    def _positions(self, message: Any) -> Array | None:
        """Where the arm's joints are, (n,), rad; None where the message is of other joints, a gripper's say."""
        if self._order is None or self._order[0] != message.name:
            where = {name: index for index, name in enumerate(message.name)}
            if not all(name in where for name in self._names):
                return None
            self._order = list(message.name), np.array([where[name] for name in self._names])
        return np.asarray(message.position, dtype=float).take(self._order[1])

    def read(self) -> JointReading:
        """Wait for the next joint state. Raises DeviceLost when none comes, or when ROS's time went back."""
        while True:
            got = self._heard.newest(self._seen, self._config.lost_after_s)
            if got is None:
                self._lose(f"no joint state on {self._heard.name} for {self._config.lost_after_s:g} s; is the "
                           "controller_manager up, and the router?")  # fmt: skip
            assert got is not None
            self._seen, sample = got
            message = self._heard.decode(sample)
            positions = self._positions(message)
            if positions is None:
                continue
            stamp = self._time.stamp_ns(message, sample)
            if stamp <= self._last_ns:
                if stamp > self._last_ns - CLOCK_BACK_NS:
                    continue
                back_s = (self._last_ns - stamp) * 1e-9
                self._time.begin_again()
                self._lose(f"the time of {self._heard.name} went back by {back_s:.1f} s: the arm's side was restarted")
            speeds = self._speeds(message, positions, stamp)
            self._last_ns = stamp
            with self._lock:
                self._measured = positions
            self._require_following(positions)
            return JointReading(stamp, positions, speeds)

    def _speeds(self, message: Any, positions: Array, stamp: int) -> Array:
        if len(message.velocity) == len(message.position):
            assert self._order is not None
            return np.asarray(message.velocity, dtype=float).take(self._order[1])
        if self._last_ns < 0:
            return np.zeros(len(positions))
        return np.asarray((positions - self._measured) / ((stamp - self._last_ns) * 1e-9))

    def _require_following(self, positions: Array) -> None:
        """An arm that is stopped by its own safety goes on telling where it is: it must not jump when it is let go."""
        if self._sent is None:
            return
        apart = np.abs(self._sent - positions)
        if float(apart.max()) > self._config.follow_within_rad:
            joint = int(np.argmax(apart))
            self._lose(
                f"the arm does not follow: {self._names[joint]} is {apart[joint]:.3f} rad from its set-point "
                f"({FIELD}.follow_within_rad is {self._config.follow_within_rad:g}); is it stopped, or its controller "
                "inactive? Nothing more is sent"
            )

    def _lose(self, why: str) -> None:
        self._away, self._sent = True, None
        raise DeviceLost(why)

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        """The next set-point. After the arm was away none goes out until it is where the arm is: it never jumps."""
        if not np.all(np.isfinite(positions_rad)):
            raise DeviceLost("a set-point is not finite: nothing was sent")
        if self._away:
            with self._lock:
                apart = float(np.abs(positions_rad - self._measured).max())
            if apart > self._config.resume_within_rad:
                return
            self._away = False
        self._sent = np.asarray(positions_rad, float)
        self._send(self._sent, speeds_rad_s)

    def _send(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        make = self._types.make
        if self._config.interface == "positions":
            layout = make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
            self._publisher.publish(make(POSITIONS, layout=layout, data=np.asarray(positions_rad, float)))
            return
        lead_ns = round(self._lead_s * 1e9)
        now = make("builtin_interfaces/msg/Time", sec=0, nanosec=0)  # zero: begin at once
        point = make(
            "trajectory_msgs/msg/JointTrajectoryPoint", positions=np.asarray(positions_rad, float),
            velocities=np.asarray(speeds_rad_s, float), accelerations=np.zeros(0), effort=np.zeros(0),
            time_from_start=make("builtin_interfaces/msg/Duration", sec=lead_ns // 10**9, nanosec=lead_ns % 10**9),
        )  # fmt: skip
        header = make("std_msgs/msg/Header", stamp=now, frame_id="")
        self._publisher.publish(make(TRAJECTORY, header=header, joint_names=list(self._names), points=[point]))

    def halt(self) -> None:
        """Stay where the encoders say that the arm is. ROS has no other stop that every arm takes."""
        with self._lock:
            measured = self._measured
        if not self._away:
            self._send(measured, np.zeros(len(measured)))


def describe(joints: RosJoints, config: ArmTopics) -> str:
    """One line for the log."""
    return (
        f"arm: {config.joint_states} at {1.0 / joints.period_s:.0f} Hz, set-points to {joints.command_topic} "
        f"({config.interface})"
    )
