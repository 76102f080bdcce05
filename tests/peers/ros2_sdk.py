"""The other end in ROS 2, by another implementation of rmw_zenoh's protocol: zenoh-ros2-sdk, in a process of its own.

    python -m tests.peers.ros2_sdk --port 7447 --definitions DIR listen /joint_states sensor_msgs/msg/JointState
    python -m tests.peers.ros2_sdk --port 7447 --definitions DIR graph
    python -m tests.peers.ros2_sdk --port 7447 --definitions DIR call /assemble
    python -m tests.peers.ros2_sdk --port 7447 --definitions DIR act --hashes JSON --cancel
    python -m tests.peers.ros2_sdk --port 7447 --definitions DIR arm --rate-hz 250

It imports nothing of crosspih but the arm's kinematics, for a plant. The message definitions are given as files, made
from rosbags' own, for the SDK would fetch them from the network. One JSON object a line on standard output.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

NAMES = ("joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6")
HOME_RAD = (-1.44, 0.98, 0.09, -1.35, -1.62, -0.07)
MOST_RAD_S = 3.0
WALL_Z_M, STIFFNESS_N_M, WEIGHT_N, CENTROID_M, TIP_M = 0.2, 2e4, 8.0, 0.03, 0.08


def write_definitions(folder: Path, types: tuple[str, ...]) -> None:
    """A .msg file for each type and for what it is made of."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in types:
        text, _ = store.generate_msgdef(name, ros_version=2)
        parts = text.split("=" * 80 + "\nMSG: ")
        for index, part in enumerate(parts):
            whole, body = (name, part) if index == 0 else part.split("\n", 1)
            pieces = whole.split("/")
            file = folder / pieces[0] / "msg" / f"{pieces[-1]}.msg"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(body, encoding="utf-8")


def told(value: Any) -> Any:
    """A message as plain values; long arrays as their length and sum."""
    if isinstance(value, np.ndarray):
        return value.tolist() if value.size <= 64 else {"size": int(value.size), "sum": int(value.sum())}
    if isinstance(value, list):
        return [told(entry) for entry in value]
    if hasattr(value, "__dataclass_fields__"):
        return {name: told(getattr(value, name)) for name in value.__dataclass_fields__ if name != "__msgtype__"}
    return value


_saying = threading.Lock()


def say(**values: Any) -> None:
    """A line of its own, whichever of the SDK's threads says it."""
    with _saying:
        print(json.dumps(values), flush=True)


def listen(given: argparse.Namespace) -> int:
    from zenoh_ros2_sdk import ROS2Subscriber
    from zenoh_ros2_sdk.qos import QosDurability, QosProfile

    write_definitions(given.definitions, (given.type,))
    done, came = threading.Event(), [0]

    def take(message: Any) -> None:
        if came[0] < given.count:
            arrived_ns = time.time_ns()
            came[0] += 1
            say(arrived_ns=arrived_ns, message=told(message))
        if came[0] >= given.count:
            done.set()

    qos = QosProfile(durability=QosDurability.TRANSIENT_LOCAL, history_depth=1) if given.late else QosProfile()
    subscriber = ROS2Subscriber(
        given.topic, given.type, take, domain_id=given.domain, router_port=given.port, qos=qos, node_name="sdk_listener"
    )
    say(key=subscriber.keyexpr)
    return 0 if done.wait(given.wait_s) else 1


def graph(given: argparse.Namespace) -> int:
    from zenoh_ros2_sdk import get_service_names_and_types, get_topic_info, get_topic_names_and_types

    at = {"domain_id": given.domain, "router_port": given.port, "timeout": 2.0}
    topics, services = get_topic_names_and_types(**at), get_service_names_and_types(**at)
    info = get_topic_info(given.topic, verbose=True, **at) if given.topic else None
    say(topics=dict(topics), services=dict(services), info=repr(info))
    return 0


def call(given: argparse.Namespace) -> int:
    from zenoh_ros2_sdk import ROS2ServiceClient
    from zenoh_ros2_sdk.utils import compute_service_type_hash

    trigger, response = "std_srvs/srv/Trigger", "bool success\nstring message\n"
    # an empty definition is refused by the SDK where it makes the hash, a comment is not
    type_hash = compute_service_type_hash(trigger, "# nothing", response)
    client = ROS2ServiceClient(
        given.service, trigger, request_definition="uint8 structure_needs_at_least_one_member\n",
        response_definition=response, type_hash=type_hash, domain_id=given.domain, router_port=given.port,
        timeout=given.wait_s,
    )  # fmt: skip
    say(key=client.keyexpr)
    answer = client.call(structure_needs_at_least_one_member=0)
    if answer is None:
        return 1
    say(success=bool(answer.success), message=str(answer.message))
    return 0


# the action's parts as flat messages: CDR puts nothing between a message and one that it is in
ACTION = "crosspih_interfaces/action/Assemble"
SEND = "uint8[16] goal_id\nstring strategy\n", "bool accepted\nint32 sec\nuint32 nanosec\n"
_POSED = "int32 {0}_sec\nuint32 {0}_nanosec\nstring {0}_frame\nfloat64[7] {0}\n"
RESULT = (
    "uint8[16] goal_id\n",
    "int8 status\nbool inserted\nstring failure\nstring text\n" + _POSED.format("hole") + _POSED.format("peg")
    + "float64 insertion_depth_m\nfloat64 duration_s\nfloat64 peak_force_n\n",
)  # fmt: skip
CANCEL = (
    "uint8[16] goal_id\nint32 sec\nuint32 nanosec\n",
    "int8 return_code\nuint32 count\nuint8[16] goal_id\nint32 sec\nuint32 nanosec\n",  # a sequence of one goal
)
FEEDBACK = "uint8[16] goal_id\nstring phase\nstring text\n"


def act(given: argparse.Namespace) -> int:
    """A goal of the action /assemble: sent, its feedback heard, cancelled if so asked, its result waited for."""
    from zenoh_ros2_sdk import ROS2ServiceClient, ROS2Subscriber

    hashes = json.loads(given.hashes)
    at = {"domain_id": given.domain, "router_port": given.port}

    def client(what: str, kind: str, parts: tuple[str, str]) -> Any:
        return ROS2ServiceClient(
            f"/assemble/_action/{what}", kind, request_definition=parts[0], response_definition=parts[1],
            type_hash=hashes[kind], timeout=given.wait_s, **at,
        )  # fmt: skip

    send, result = client("send_goal", f"{ACTION}_SendGoal", SEND), client("get_result", f"{ACTION}_GetResult", RESULT)
    cancel = client("cancel_goal", "action_msgs/srv/CancelGoal", CANCEL)
    felt = threading.Event()

    def feedback(message: Any) -> None:
        say(feedback=[message.phase, message.text], goal=bytes(message.goal_id).hex())
        felt.set()

    heard = ROS2Subscriber(
        "/assemble/_action/feedback", f"{ACTION}_FeedbackMessage", feedback, msg_definition=FEEDBACK,
        type_hash=hashes[f"{ACTION}_FeedbackMessage"], **at,
    )  # fmt: skip
    say(key=send.keyexpr, listens=heard.keyexpr)
    goal_id = np.frombuffer(os.urandom(16), dtype=np.uint8)
    sent = send.call(goal_id=goal_id, strategy=given.strategy)
    say(accepted=bool(sent.accepted), goal=bytes(goal_id).hex())
    if not sent.accepted:
        return 0
    if given.cancel:
        felt.wait(given.wait_s)
        asked = cancel.call(goal_id=goal_id, sec=0, nanosec=0)
        say(cancelled=int(asked.return_code), goals=int(asked.count))
    ended = result.call(goal_id=goal_id)
    say(
        status=int(ended.status), inserted=bool(ended.inserted), failure=ended.failure, text=ended.text,
        frame=ended.hole_frame, hole=np.asarray(ended.hole).tolist(), depth=ended.insertion_depth_m,
    )  # fmt: skip
    return 0


class Arm:
    """ros2_control's side of an arm: position set-points in, joint states and wrenches out, at one rate."""

    def __init__(self, given: argparse.Namespace) -> None:
        from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber
        from zenoh_ros2_sdk.message_registry import get_message_class

        from crosspih_common.arm import named_arm

        state, wrench = "sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"
        positions, trajectory = "std_msgs/msg/Float64MultiArray", "trajectory_msgs/msg/JointTrajectory"
        write_definitions(given.definitions, (state, wrench, positions, trajectory))
        at = {"domain_id": given.domain, "router_port": given.port}
        self._states = ROS2Publisher("/joint_states", state, node_name="joint_state_broadcaster", **at)
        self._wrenches = ROS2Publisher(
            "/force_torque_sensor_broadcaster/wrench", wrench, node_name="force_torque_sensor_broadcaster", **at
        )
        self._commands = (
            ROS2Subscriber(
                "/forward_position_controller/commands", positions, self._hear_positions,
                node_name="forward_position_controller", **at,
            ),
            ROS2Subscriber(
                "/joint_trajectory_controller/joint_trajectory", trajectory, self._hear_trajectory,
                node_name="joint_trajectory_controller", **at,
            ),
        )  # fmt: skip
        names = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "geometry_msgs/msg/Wrench",
                 "geometry_msgs/msg/Vector3")  # fmt: skip
        self._header, self._time, self._wrench, self._vector = (get_message_class(name) for name in names)
        self._model, self._rate_hz, self._shuffled = named_arm("xb4"), given.rate_hz, given.shuffled
        self.at_rad = np.array(given.at or HOME_RAD, float)
        self._goal_rad = self.at_rad
        self.heard, self.stopped = 0, False
        self.lags_s: list[float] = []  # from a joint state sent to the set-point that answers it
        self._sent_s = 0.0

    def _hear_positions(self, message: Any) -> None:
        self.lags_s.append(time.monotonic() - self._sent_s)
        self._take(message.data)

    def _hear_trajectory(self, message: Any) -> None:
        self._take(message.points[-1].positions)

    def _take(self, goal_rad: Any) -> None:
        self.heard += 1
        if not self.stopped:
            self._goal_rad = np.asarray(goal_rad, float)

    def safety(self) -> None:
        """A protective stop, or its release: states go on, set-points are not followed, the arm stands."""
        self.stopped, self._goal_rad = not self.stopped, self.at_rad
        say(stopped=self.stopped)

    def cycle(self) -> None:
        """One update of the controller_manager."""
        most = MOST_RAD_S / self._rate_hz
        step = np.clip(self._goal_rad - self.at_rad, -most, most)
        self.at_rad = self.at_rad + step
        now_ns = time.time_ns()
        header = self._header(
            stamp=self._time(sec=now_ns // 10**9, nanosec=now_ns % 10**9), frame_id="base_link"
        )  # fmt: skip
        # joint_state_broadcaster may tell the joints in any order, and those of a gripper with them
        order = [5, 2, 0, 1, 3, 4] if self._shuffled else list(range(6))
        names = [NAMES[index] for index in order] + (["finger_joint"] if self._shuffled else [])
        extra = [0.02] if self._shuffled else []
        self._states.publish(
            header=header, name=names, position=np.array([*self.at_rad[order], *extra]),
            velocity=np.array([*(step[order] * self._rate_hz), *(0.0 for _ in extra)]), effort=np.zeros(0),
        )  # fmt: skip
        self._sent_s = time.monotonic()
        force, torque = self._felt()
        self._wrenches.publish(
            header=header, wrench=self._wrench(force=self._vector(*force), torque=self._vector(*torque))
        )

    def _felt(self) -> tuple[list[float], list[float]]:
        """The tool's weight, and a springy floor under its tip, in the flange's axes."""
        flange = self._model.pose_base_flange(self.at_rad)
        tip_m = flange.apply(np.array([0.0, 0.0, TIP_M]))
        push_n = STIFFNESS_N_M * max(0.0, WALL_Z_M - float(tip_m[2]))
        floor, weight = (flange.rotation.T @ np.array([0.0, 0.0, z]) for z in (push_n, -WEIGHT_N))
        moment = np.cross([0.0, 0.0, TIP_M], floor) + np.cross([0.0, 0.0, CENTROID_M], weight)
        return (floor + weight).tolist(), moment.tolist()


def arm(given: argparse.Namespace) -> int:
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda number, frame: stop.set())
    sys.setswitchinterval(0.001)
    plant = Arm(given)
    signal.signal(signal.SIGUSR1, lambda number, frame: plant.safety())
    say(ready=True)
    period_s, began_s, late, cycles, worst_s = 1.0 / given.rate_hz, time.monotonic(), 0, 0, 0.0
    next_s = began_s
    while not stop.is_set():
        next_s += period_s
        ahead_s = next_s - time.monotonic()
        if ahead_s > 0.0:
            time.sleep(ahead_s)
        else:
            worst_s = max(worst_s, -ahead_s)
            late += -ahead_s > period_s
            next_s = max(next_s, time.monotonic() - period_s)
        plant.cycle()
        cycles += 1
    p50, p95 = np.percentile(plant.lags_s, [50, 95]).tolist() if plant.lags_s else (None, None)
    lags: dict[str, float | None] = {"lag_p50_s": p50, "lag_p95_s": p95}
    say(
        cycles=cycles, late=late, worst_s=worst_s, heard=plant.heard, seconds=time.monotonic() - began_s,
        at_rad=plant.at_rad.tolist(), **lags,
    )  # fmt: skip
    return 0


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--domain", type=int, default=0)
    parser.add_argument("--definitions", type=Path, required=True)
    modes = parser.add_subparsers(dest="mode", required=True)
    mode = modes.add_parser("listen")
    mode.add_argument("topic")
    mode.add_argument("type")
    mode.add_argument("--count", type=int, default=1)
    mode.add_argument("--late", action="store_true")
    mode.add_argument("--wait-s", type=float, default=20.0)
    modes.add_parser("graph").add_argument("topic", nargs="?")
    mode = modes.add_parser("call")
    mode.add_argument("service")
    mode.add_argument("--wait-s", type=float, default=20.0)
    mode = modes.add_parser("act")
    mode.add_argument("--hashes", required=True, help="JSON: type to hash")
    mode.add_argument("--strategy", default="")
    mode.add_argument("--cancel", action="store_true")
    mode.add_argument("--wait-s", type=float, default=30.0)
    mode = modes.add_parser("arm")
    mode.add_argument("--rate-hz", type=float, default=250.0)
    mode.add_argument("--shuffled", action="store_true")
    mode.add_argument("--at", type=float, nargs=6)
    given = parser.parse_args()
    os.environ["ZENOH_ROS2_SDK_CACHE"] = str(given.definitions / "no-network")
    from zenoh_ros2_sdk import ZenohSession, get_registry

    session = ZenohSession.get_instance("127.0.0.1", given.port)
    get_registry(str(given.definitions))
    try:
        return {"listen": listen, "graph": graph, "call": call, "act": act, "arm": arm}[given.mode](given)
    finally:
        session.close()


if __name__ == "__main__":
    sys.exit(main())
