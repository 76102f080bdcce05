"""`python -m services.hardware.peers.ros2 --cell CELL --devices arm,force_torque`: a simulated ros2_control arm.

It publishes /joint_states and /force_torque_sensor_broadcaster/wrench once a cycle and follows
/forward_position_controller/commands, as joint_state_broadcaster, force_torque_sensor_broadcaster and
forward_position_controller do; with `--devices camera`, a process of its own, two Image topics with camera_infos. The
cell's file names the arm, `hardware.simulated` and its seed; `hardware.ros2` the topics. Stamps are the simulated
cell's time, begun at this machine's. The lines `truth` and `state` on standard input are answered by one line of JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
import time
from collections import deque
from types import FrameType
from typing import Any

import numpy as np

from crosspih_common.bus import DEFAULT_ENDPOINT
from crosspih_common.config import Workcell, load_cell
from crosspih_common.errors import CrosspihError
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Image
from crosspih_common.modules import DEFAULT_CELL
from crosspih_common.ros2 import RosNode, RosQos, RosSample
from crosspih_common.ros2.converting import Converter
from services.hardware.config import HardwareConfig
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.ros2.config import Ros2Config
from services.hardware.drivers.ros2.joints import COMMANDS
from services.hardware.drivers.ros2.opening import joint_names
from services.hardware.drivers.simulated.cell import open_devices
from services.hardware.protocols import CameraDevice, Devices, JointReading

PICTURES_HZ = 4.0
SERVO_RAD_S, WINDOW = 50.0, 6
LATE = 1.5  # cycles of wall time from one to the next


class Servo:
    """The arm's own servo: set-points that come unevenly are followed smoothly, as an arm's controller does.

    A critically damped follower of the set-points and of their mean speed over `WINDOW` cycles, so that a steady motion
    is followed without lag; one that sets in or ends is by some 20 ms late.
    """

    def __init__(self, at_rad: Array, period_s: float) -> None:
        self.at_rad, self.speeds_rad_s = at_rad, np.zeros(len(at_rad))
        self._period_s = period_s
        self._goals: deque[Array] = deque([at_rad], maxlen=WINDOW)

    def follow(self, goal_rad: Array) -> None:
        """One cycle towards the newest set-point (n,), which may be the one of before."""
        self._goals.append(goal_rad)
        spanned_s = max(1, len(self._goals) - 1) * self._period_s
        wanted = (self._goals[-1] - self._goals[0]) / spanned_s
        pull = SERVO_RAD_S**2 * (goal_rad - self.at_rad) + 2.0 * SERVO_RAD_S * (wanted - self.speeds_rad_s)
        self.speeds_rad_s = self.speeds_rad_s + pull * self._period_s
        self.at_rad = self.at_rad + self.speeds_rad_s * self._period_s


class PeerArm:
    """The arm's side: states and wrenches out, set-points in; one that is not of the right size is ignored."""

    def __init__(self, node: RosNode, config: Ros2Config, names: tuple[str, ...], devices: Devices) -> None:
        assert devices.joints is not None and devices.wrench is not None
        self._joints, self._wrench, self._names = devices.joints, devices.wrench, names
        self._types, self._convert = node.types, Converter(node.types)
        self._states = node.publisher(config.arm.joint_states, "sensor_msgs/msg/JointState")
        self._wrenches = node.publisher(config.force_torque.topic, "geometry_msgs/msg/WrenchStamped")
        topic, self._kind = COMMANDS[config.arm.interface]
        self._newest: RosSample | None = None
        self._began_ns = 0
        self.cycles = self.late_cycles = 0
        node.subscribe(config.arm.commands or topic, self._kind, self._hear, RosQos())

    def _hear(self, sample: RosSample) -> None:
        self._newest = sample

    def run(self, stop: threading.Event) -> None:
        """Cycle until told to end."""
        reading = self._joints.read()
        self._began_ns = time.time_ns() - reading.stamp_ns
        goal = np.array(reading.positions_rad)
        servo = Servo(goal, self._joints.period_s)
        late_s, before_s = LATE * self._joints.period_s, time.monotonic()
        while not stop.is_set():
            now_s = time.monotonic()
            self.cycles += 1
            self.late_cycles += now_s - before_s > late_s
            before_s = now_s
            self._tell(reading)
            sample, self._newest = self._newest, None
            if sample is not None:
                asked = self._asked(self._types.decode(sample.payload, self._kind))
                goal = goal if asked is None else asked
            servo.follow(goal)
            self._joints.write(servo.at_rad, servo.speeds_rad_s)
            reading = self._joints.read()

    def _asked(self, message: Any) -> Array | None:
        data = message.points[-1].positions if self._kind.startswith("trajectory") else message.data
        asked = np.asarray(data, float)
        return asked if asked.shape == (len(self._names),) and bool(np.all(np.isfinite(asked))) else None

    def _tell(self, reading: JointReading) -> None:
        samples = self._wrench.read()
        if len(samples.wrenches):
            mean = samples.wrenches.mean(axis=0).tolist()
            self._wrenches.publish(self._convert.wrench(mean, "ft_frame", self._began_ns + int(samples.stamps_ns[-1])))
        stamp_ns = self._began_ns + reading.stamp_ns
        make, header = self._types.make, self._convert.header(stamp_ns, "base_link")
        self._states.publish(
            make("sensor_msgs/msg/JointState", header=header, name=list(self._names), position=reading.positions_rad,
                 velocity=reading.speeds_rad_s, effort=np.zeros(0))
        )  # fmt: skip


def answer(arm: PeerArm, devices: Devices) -> None:
    """What standard input asks: for who started it, to score by."""
    for line in sys.stdin:
        if line.strip() == "truth" and devices.simulation is not None:
            print(devices.simulation.truth().model_dump_json(), flush=True)
        elif line.strip() == "state":
            print(json.dumps({"cycles": arm.cycles, "late_cycles": arm.late_cycles}), flush=True)
        else:
            print(f"no such thing as {line.strip()}: truth, state", flush=True)


def show(node: RosNode, config: Ros2Config, camera: CameraDevice, stop: threading.Event) -> None:
    """Pictures of the cell whose arm stands at home, some each second."""
    convert, names = Converter(node.types), config.camera
    kept = RosQos(transient_local=True, depth=1)
    images = [node.publisher(name, "sensor_msgs/msg/Image") for name in (names.left, names.right)]
    infos = [node.publisher(name, "sensor_msgs/msg/CameraInfo", kept) for name in (names.left_info, names.right_info)]
    frames = "camera_left", "camera_right"
    while not stop.wait(1.0 / PICTURES_HZ):
        taken, stamp_ns = camera.capture(1.0, 0), time.time_ns()
        pair = (taken.left, taken.left_encoding), (taken.right, taken.right_encoding)
        for publisher, info in zip(infos, convert.camera_infos(camera.calibration(), frames, stamp_ns), strict=True):
            publisher.publish(info)
        for publisher, frame, (pixels, encoding) in zip(images, frames, pair, strict=True):
            publisher.publish(convert.image(Image(frame, pixels, stamp_ns, encoding=encoding), stamp_ns))


def main() -> int:
    """Run until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(
        prog="python -m services.hardware.peers.ros2", description="A simulated ROS 2 arm."
    )
    parser.add_argument("--cell", default=os.environ.get("CROSSPIH_CELL") or DEFAULT_CELL)
    parser.add_argument("--endpoint", default=os.environ.get("CROSSPIH_ENDPOINT") or DEFAULT_ENDPOINT)
    parser.add_argument("--devices", choices=("arm,force_torque", "camera"), default="arm,force_torque")
    parser.add_argument("--seed", type=int, default=None, help="draws the hole; the cell's own when left out")
    given = parser.parse_args()
    stop = threading.Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    sys.setswitchinterval(0.001)
    try:
        cell = load_cell(given.cell)
        hardware = cell.section("hardware", HardwareConfig)
        run(cell.workcell, hardware, given.devices.split(","), given.endpoint, given.seed, stop)
    except CrosspihError as error:
        print(f"peer: {error}", file=sys.stderr, flush=True)
        return 1
    return 0


def run(
    workcell: Workcell, hardware: HardwareConfig, wanted: list[str], endpoint: str, seed: int | None,
    stop: threading.Event,
) -> None:  # fmt: skip
    """Open the simulated devices and speak for them until told to end."""
    if seed is not None:
        hardware = hardware.model_copy(update={"simulated": hardware.simulated.model_copy(update={"seed": seed})})
    config = hardware.ros2 or Ros2Config()
    request = OpenRequest(workcell, hardware, frozenset(wanted), realtime=True)
    devices = open_devices(request)
    try:
        with config.open(
            "hardware.ros2", "simulated_arm" if "arm" in wanted else "simulated_cameras", endpoint
        ) as node:
            print(f"peer: {', '.join(wanted)} in domain {node.domain_id} at {endpoint}", flush=True)
            if "arm" in wanted:
                arm = PeerArm(node, config, joint_names(request, config), devices)
                threading.Thread(target=answer, args=(arm, devices), name="answers", daemon=True).start()
                arm.run(stop)
            else:
                assert devices.camera is not None
                show(node, config, devices.camera, stop)
    finally:
        devices.close()


if __name__ == "__main__":
    sys.exit(main())
