"""The bridge as a process of its own, between our bus and another implementation of ROS 2 over Zenoh."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.errors import CommandRefused
from crosspih_common.keys import ABORT, ASSEMBLE, CAMERA_CALIBRATION, CLOCK, CONTACT_WRENCH, IMAGE_LEFT, JOINT_STATE
from crosspih_common.messages import (
    AbortAccepted,
    AbortAssembly,
    Assemble,
    AssemblyResult,
    CameraCalibration,
    CameraModel,
    CellClock,
    ContactWrench,
    Image,
    JointState,
    PoseData,
    Strategy,
)
from crosspih_common.messages.assembly import AnyStrategy
from crosspih_common.ros2 import Entity, RosNode, RosTypes
from tests.conftest import ServiceProcess, started_router
from tests.ros2.sdk import SdkProcess

pytest.importorskip("rosbags")
pytest.importorskip("zenoh_ros2_sdk")

SECOND = 1_000_000_000
JOINTS = (-1.44, 0.98, 0.09, -1.35, -1.62, -0.07)
PICTURE = np.arange(48, dtype=np.uint8).reshape(6, 8)
CAMERA = CameraModel(width_px=8, height_px=6, fx_px=5.0, fy_px=5.0, cx_px=3.5, cy_px=2.5)
Sdk = Callable[..., SdkProcess]
OUT = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/wrench": "geometry_msgs/msg/WrenchStamped",
    "/wrench_raw": "geometry_msgs/msg/WrenchStamped",
    "/hole_pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/assembled_pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/camera/left/image_raw": "sensor_msgs/msg/Image",
    "/camera/right/image_raw": "sensor_msgs/msg/Image",
    "/camera/left/camera_info": "sensor_msgs/msg/CameraInfo",
    "/camera/right/camera_info": "sensor_msgs/msg/CameraInfo",
    "/robot_description": "std_msgs/msg/String",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}


class Cell:
    """What the other services would say and serve, with known values."""

    def __init__(self, endpoint: str) -> None:
        self.hardware = Bus(open_zenoh(endpoint), "cell1", "hardware")
        self.force_torque = Bus(open_zenoh(endpoint), "cell1", "force_torque")
        self.planning = Bus(open_zenoh(endpoint), "cell1", "planning")
        self.asked: list[AnyStrategy] = []
        self.let_go = threading.Event()
        self._closing = threading.Event()
        self._publish_states()
        self.planning.serve(ASSEMBLE, self._assemble)
        self.planning.serve(ABORT, self._abort, lane="now")
        self._ticking = threading.Thread(target=self._tick, daemon=True)
        self._ticking.start()

    def _publish_states(self) -> None:
        pose = PoseData(position_m=(0.1, 0.2, 0.3), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
        beside = PoseData(position_m=(0.05, 0.0, 0.0), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
        calibration = CameraCalibration(
            stamp_ns=0, left=CAMERA, right=CAMERA, pose_left_right=beside, pose_base_camera=pose
        )
        self.hardware.publisher(CAMERA_CALIBRATION).publish(calibration)
        self.hardware.publisher(IMAGE_LEFT).publish(Image("camera_left", PICTURE, 0))

    def _tick(self) -> None:
        clock, joints = self.hardware.publisher(CLOCK), self.hardware.publisher(JOINT_STATE)
        wrench = self.force_torque.publisher(CONTACT_WRENCH)
        count = 0
        while not self._closing.wait(0.01):
            count += 1
            stamp_ns = count * 10_000_000
            clock.publish(CellClock(stamp_ns=stamp_ns, boot_id="a", realtime=True, simulated=False))
            joints.publish(JointState(stamp_ns=stamp_ns, joints_rad=JOINTS, speeds_rad_s=(0.5,) * 6))
            wrench.publish(
                ContactWrench(stamp_ns=stamp_ns, wrench=(1.0, 2.0, -3.0, 0.1, 0.2, 0.3), in_contact=True,
                              free_residual_n=0.0, drift_suspected=False)
            )  # fmt: skip

    def _assemble(self, request: Assemble) -> AssemblyResult:
        self.asked.append(request.strategy)
        if len(self.asked) > 1:
            raise CommandRefused("held", "somebody else holds the arm: teach pendant")
        assert self.let_go.wait(30.0)
        return AssemblyResult(
            assembly_id="a", strategy=request.strategy, inserted=True, failure=None, backed_off=False,
            pose_base_hole=PoseData(position_m=(0.4, -0.3, 0.2), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0)),
            pose_base_peg=None, vision_pose_base_hole=None, motion_s=12.0, thinking_s=0.5, touches=0, presses=4,
            corrections=0, pushes=1, peak_force_n=6.25, peak_moment_nm=0.5, insertion_depth_m=0.0251,
        )  # fmt: skip

    def _abort(self, request: AbortAssembly) -> AbortAccepted:
        return AbortAccepted(was_running=bool(self.asked))

    def close(self) -> None:
        self.let_go.set()
        self._closing.set()
        self._ticking.join()
        for bus in (self.hardware, self.force_torque, self.planning):
            bus.close()


@pytest.fixture
def cell(endpoint: str) -> Iterator[Cell]:
    cell = Cell(endpoint)
    yield cell
    cell.close()


def test_what_the_cell_says_is_heard_in_ros_and_an_assembly_is_asked_for(
    endpoint: str, cell: Cell, sdk: Sdk, spawn: Callable[..., ServiceProcess]
) -> None:
    bridge = spawn("ros2", "--endpoint", endpoint)
    # one process after another costs seconds: they start together
    joints = sdk("listen", "/joint_states", OUT["/joint_states"], "--count", "5")
    wrench, links = sdk("listen", "/wrench", OUT["/wrench"]), sdk("listen", "/tf", OUT["/tf"])
    assert bridge.wait_for_line("node /crosspih in domain 0")
    first = sdk("call", "/assemble")

    for _ in range(5):
        told = joints.said("message")
        stamp = told["message"]["header"]["stamp"]
        # the cell's clock begins at 0, ROS hears the wall's
        assert abs(stamp["sec"] * SECOND + stamp["nanosec"] - told["arrived_ns"]) < 2 * SECOND
        assert told["message"]["name"] == [f"joint_{index}" for index in range(1, 7)]
        assert (told["message"]["position"], told["message"]["velocity"]) == (list(JOINTS), [0.5] * 6)
    felt = wrench.said("message")["message"]
    assert felt["header"]["frame_id"] == "peg"
    assert felt["wrench"] == {"force": dict(x=1.0, y=2.0, z=-3.0), "torque": dict(x=0.1, y=0.2, z=0.3)}
    chain = [
        (one["header"]["frame_id"], one["child_frame_id"]) for one in links.said("message")["message"]["transforms"]
    ]
    names = ["base_link", *(f"link_{index}" for index in range(1, 7)), "tool0"]
    assert chain == list(itertools.pairwise(names))

    # while the first assembly is carried out a second one is refused, not queued, and an abort passes
    first.said("key")
    wait_until(lambda: bool(cell.asked), "the assembly is asked for")
    second, abort, graph = sdk("call", "/assemble"), sdk("call", "/abort"), sdk("graph", "/joint_states")
    late = sdk("listen", "/camera/left/image_raw", OUT["/camera/left/image_raw"])
    description = sdk("listen", "/robot_description", OUT["/robot_description"], "--late")
    static = sdk("listen", "/tf_static", OUT["/tf_static"], "--late")
    assert second.said("success") == {
        "success": False, "message": "busy: another assembly or withdrawal is being carried out; nothing was queued",
    }  # fmt: skip
    assert abort.said("success") == {"success": True, "message": "the assembly was told to end"}
    assert cell.asked == [Strategy.FUSED]
    cell.let_go.set()
    assert first.said("success") == {"success": True, "message": "inserted, 25.1 mm deep, 12.5 s, peak 6.2 N"}

    # late readers are given what was said last
    assert '<joint name="joint_1" type="revolute">' in description.said("message")["message"]["data"]
    placed = {
        one["child_frame_id"]: one["header"]["frame_id"] for one in static.said("message")["message"]["transforms"]
    }
    assert placed.items() >= {"peg": "tool0", "camera_left": "base_link", "camera_right": "camera_left"}.items()

    there = graph.said("topics")
    assert {name: types for name, types in there["topics"].items() if name in OUT} == {n: [t] for n, t in OUT.items()}
    trigger = ["std_srvs/srv/Trigger"]
    assert there["services"].items() >= {"/assemble": trigger, "/withdraw": trigger, "/abort": trigger}.items()
    assert "crosspih" in there["info"]

    late.said("key")
    cell.hardware.publisher(IMAGE_LEFT).publish(Image("camera_left", PICTURE, 7))
    image = late.said("message")["message"]
    assert (image["width"], image["height"], image["encoding"], image["step"]) == (8, 6, "mono8", 8)
    assert image["data"] == PICTURE.ravel().tolist()

    # a refusal is told as it is
    refused = sdk("call", "/assemble").said("success")
    assert refused == {"success": False, "message": "held: somebody else holds the arm: teach pendant"}
    assert bridge.terminate() == 0, "".join(bridge.output)[-3000:]
    with RosNode(endpoint, 0, RosTypes(), "looking") as node:
        left = [one for one in node.graph() if one.node == "crosspih"]
        assert not left  # whoever has gone is no longer in the graph


def test_the_tokens_are_those_that_the_sdk_writes(endpoint: str, sdk: Sdk) -> None:
    sdk("arm", "--rate-hz", "50").said("ready")
    with RosNode(endpoint, 0, RosTypes(), "looking") as node:
        found = {(one.entity, one.name): one for one in node.graph() if one.entity is not Entity.NODE}
        states = found[Entity.PUBLISHER, "/joint_states"]
        assert (states.node, states.ros_type) == ("joint_state_broadcaster", OUT["/joint_states"])
        for one in found.values():
            assert one.type_hash == node.types.hash(one.ros_type)
            # the token read and written again is the token
            assert one.of(one.token()) == one


def test_nodes_of_ros_hear_each_other_through_a_router_for_peers(
    spawn: Callable[..., ServiceProcess], tmp_path: Path
) -> None:
    _, endpoint = started_router(spawn, "--peers")
    folders = [tmp_path / name for name in ("arm", "listener")]
    for folder in folders:
        folder.mkdir()
    arm = SdkProcess(endpoint, folders[0], "arm", "--rate-hz", "20")
    listener = SdkProcess(endpoint, folders[1], "listen", "/joint_states", OUT["/joint_states"])
    try:
        assert len(listener.said("message")["message"]["position"]) == 6
    finally:
        listener.close()
        arm.close()


def wait_until(condition: Callable[[], bool], what: str) -> None:
    until = time.monotonic() + 20.0
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < until, f"not in time: {what}"
        pause.wait(0.01)
