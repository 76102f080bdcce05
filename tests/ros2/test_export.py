"""A recording as a ROS 2 bag, read back by two readers that know nothing of ours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from crosspih_common.bus.codec import encode
from crosspih_common.geometry import Pose
from crosspih_common.keys import CAMERA_CALIBRATION, CLOCK, IMAGE_LEFT, JOINT_STATE, LOCATE, STATUS, WRENCH_RAW, Topic
from crosspih_common.messages import (
    CameraCalibration,
    CameraModel,
    CellClock,
    HoleEstimate,
    Image,
    JointState,
    LocateMethod,
    PoseData,
    RawWrenchBatch,
    ServiceState,
    ServiceStatus,
)
from services.operator.cli.commands import app
from services.recorder.config import RecorderConfig
from services.recorder.recorder import Recorder

pytest.importorskip("rosbags")
pytest.importorskip("mcap_ros2")
SECOND = 1_000_000_000
LEFT = CameraModel(width_px=8, height_px=6, fx_px=5.0, fy_px=5.1, cx_px=3.5, cy_px=2.5)
CELL = "cell:\n  name: c\nros2:\n  joint_names: [a, b, c, d, e, f]\n  base_frame: world\n"
POSE = Pose.from_rotvec([0.3, -0.2, 0.9], [0.4, -0.3, 0.2])
COVARIANCE = np.diag([1e-6, 2e-6, 3e-6, 4e-4, 5e-4, 6e-4])
PICTURE = np.arange(48, dtype=np.uint16).reshape(6, 8) * 1000


def states() -> list[JointState]:
    return [
        JointState(
            stamp_ns=SECOND + index * 4_000_000, seq=index, joints_rad=(0.1 * index, -0.2, 0.3, -0.4, 0.5, -0.6),
            speeds_rad_s=(0.01 * index,) * 6,
        )
        for index in range(5)
    ]  # fmt: skip


def batch() -> RawWrenchBatch:
    rows = tuple(tuple(float(index * 10 + axis) for axis in range(6)) for index in range(3))
    return RawWrenchBatch(stamp_ns=SECOND, seq=0, period_ns=1_000_000, samples=rows)


def said() -> list[tuple[Topic[Any], Any]]:
    pose = PoseData.of(POSE)
    estimate = HoleEstimate(
        stamp_ns=SECOND + 5, seq=0, pose_base_hole=pose, covariance=tuple(COVARIANCE.ravel().tolist()),
        method=LocateMethod.RIM, orientation_measured=True, capture_id=1, capture_wall_s=0.1,
    )  # fmt: skip
    calibration = CameraCalibration(
        stamp_ns=SECOND, seq=0, left=LEFT, right=LEFT, pose_base_camera=pose,
        pose_left_right=PoseData.of(Pose.from_translation([0.05, 0.0, 0.0])),
    )  # fmt: skip
    return [
        (CLOCK, CellClock(stamp_ns=SECOND, seq=0, boot_id="x", realtime=True, simulated=True)),
        (CAMERA_CALIBRATION, calibration),
        *((JOINT_STATE, state) for state in states()),
        (WRENCH_RAW, batch()),
        (IMAGE_LEFT, Image("camera_left", PICTURE, SECOND, 0)),
        (LOCATE.reply_echo, estimate),
        (
            STATUS,
            ServiceStatus(stamp_ns=SECOND, seq=0, service="vision", state=ServiceState.READY, pid=1, uptime_s=2.0),
        ),
    ]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Written by the real recorder."""
    folder = tmp_path_factory.mktemp("recordings")
    config = RecorderConfig(directory=folder, quiet_s=0.0)
    failures: list[str] = []
    words = {"cell": {"name": "c", "path": "c.yaml", "yaml": CELL}}
    recorder = Recorder(config, lambda: words, lambda code, text: failures.append(text))
    path = Path(recorder.start("one", 0).path)
    for topic, value in said():
        recorder.taker(topic, topic.key("c", "vision"), pytest.fail, pytest.fail)(encode(value), value.seq)
    recorder.stop(SECOND)
    recorder.close()
    assert not failures
    return path


@pytest.fixture(scope="module")
def bag(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("bags") / "out"
    done = CliRunner().invoke(app, ["recording", "export", "ros2", str(recording), str(out), "--cell-stamps"])
    assert done.exit_code == 0, done.output
    assert "/joint_states" in done.output
    return out


def by_rosbags(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    from rosbags.highlevel import AnyReader

    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([bag]) as reader:
        for connection, stamp_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((stamp_ns, message))
    return found


def by_mcap(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    found: dict[str, list[tuple[int, Any]]] = {}
    with next(bag.glob("*.mcap")).open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, entry, message in reader.iter_decoded_messages():
            assert schema is not None and (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            found.setdefault(channel.topic, []).append((entry.log_time, message))
    return found


@pytest.mark.parametrize("read", [by_rosbags, by_mcap])
def test_two_readers_find_the_same_values(bag: Path, read: Any) -> None:
    found = read(bag)
    told = [message for _, message in found["/joint_states"]]
    assert [list(message.name) for message in told] == [list("abcdef")] * 5
    for message, state in zip(told, states(), strict=True):
        assert list(message.position) == list(state.joints_rad) and list(message.velocity) == list(state.speeds_rad_s)
        assert message.header.stamp.sec * SECOND + message.header.stamp.nanosec == state.stamp_ns
        assert message.header.frame_id == "world"
    rows = [[w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z]
            for w in (message.wrench for _, message in found["/wrench_raw"])]  # fmt: skip
    assert rows == [list(row) for row in batch().samples]  # the default cell's sensor says N and Nm in the peg frame
    [(_, image)] = found["/camera/left/image_raw"]
    assert (image.width, image.height, image.encoding, image.step, image.is_bigendian) == (8, 6, "mono16", 16, 0)
    assert np.array_equal(np.frombuffer(bytes(image.data), "<u2").reshape(6, 8), PICTURE)
    [(_, hole)] = found["/hole_pose"]
    position, turn = hole.pose.pose.position, hole.pose.pose.orientation
    read_back = Pose.from_quaternion([turn.x, turn.y, turn.z, turn.w], [position.x, position.y, position.z])
    assert np.allclose(read_back.matrix(), POSE.matrix(), atol=1e-12)
    rotation = POSE.rotation
    blocks = np.array(hole.pose.covariance).reshape(6, 6)
    assert np.allclose(blocks[:3, :3], rotation @ COVARIANCE[:3, :3] @ rotation.T)
    assert np.allclose(blocks[3:, 3:], rotation @ COVARIANCE[3:, 3:] @ rotation.T)
    static = {transform.child_frame_id: transform for transform in found["/tf_static"][-1][1].transforms}
    assert set(static) == {"peg", "camera_left", "camera_right", "hole"}
    assert static["hole"].header.frame_id == "world" and static["hole"].transform.translation.x == POSE.translation_m[0]
    [(_, description)] = found["/robot_description"]
    assert 'joint name="a"' in description.data
    links = [transform.child_frame_id for transform in found["/tf"][0][1].transforms]
    assert links == [*(f"link_{index}" for index in range(1, 7)), "tool0"]


def test_metadata_is_rosbag2s_own(bag: Path) -> None:
    said = yaml.safe_load((bag / "metadata.yaml").read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
    assert (said["version"], said["storage_identifier"]) == (9, "mcap")
    assert [Path(path).suffix for path in said["relative_file_paths"]] == [".mcap"]
    topics = {one["topic_metadata"]["name"]: one for one in said["topics_with_message_count"]}
    assert topics["/joint_states"]["message_count"] == 5
    assert topics["/joint_states"]["topic_metadata"]["type"] == "sensor_msgs/msg/JointState"
    assert topics["/joint_states"]["topic_metadata"]["serialization_format"] == "cdr"
    profiles = topics["/tf_static"]["topic_metadata"]["offered_qos_profiles"]
    assert profiles[0]["durability"] == "transient_local"


def test_what_is_wrong_is_said(recording: Path, bag: Path, tmp_path: Path) -> None:
    for arguments, why in (
        ([str(recording), str(bag)], "is there already"),
        ([str(tmp_path / "none.mcap"), str(tmp_path / "x")], "cannot be read"),
        ([str(recording), str(tmp_path / "x"), "--distro", "foxy"], "want humble, jazzy"),
    ):
        done = CliRunner().invoke(app, ["recording", "export", "ros2", *arguments])
        assert done.exit_code == 1 and why in " ".join(done.output.split()), done.output
    assert not (tmp_path / "x").exists()
