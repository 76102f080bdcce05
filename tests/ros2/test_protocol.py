"""Bytes, keys and tokens against the serialiser of Zenoh itself, rmw_zenoh's documents, and another implementation."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rosbags")

from rosbags.interfaces import Nodetype
from zenoh import ext
from zenoh.ext import Int64

from crosspih_common.ros2 import Entity, GraphEntity, RosQos, RosTypes, SampleAttachment, actions, dds_type, topic_key
from crosspih_common.ros2.names import graph_expression, resolved, ros_type
from crosspih_common.ros2.stamps import WallOfCell

TYPES = RosTypes()
SPOKEN = (
    "sensor_msgs/msg/JointState",
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/msg/WrenchStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CameraInfo",
    "std_msgs/msg/String",
    "std_msgs/msg/Float64MultiArray",
    "diagnostic_msgs/msg/DiagnosticArray",
    "trajectory_msgs/msg/JointTrajectory",
)
GID = bytes(range(16))
INT64 = st.integers(min_value=-(2**63), max_value=2**63 - 1)


@given(INT64, INT64, st.binary(min_size=16, max_size=16))
def test_an_attachment_is_what_zenohs_own_serialiser_writes(sequence: int, stamp_ns: int, gid: bytes) -> None:
    ours = SampleAttachment(sequence, stamp_ns, gid)
    # AttachmentData::serialize_to_zbytes: int64, int64, array of 16 bytes
    assert ours.to_bytes() == ext.z_serialize((Int64(sequence), Int64(stamp_ns), gid)).to_bytes()
    assert SampleAttachment.of(ours.to_bytes()) == ours


def test_an_attachment_of_an_old_release_is_named() -> None:
    old = ext.z_serialize(("sequence_number", Int64(1), "source_timestamp", Int64(2), "source_gid", GID)).to_bytes()
    with pytest.raises(ValueError, match=r"0\.2\.4 \(jazzy\)"):
        SampleAttachment.of(old)
    with pytest.raises(ValueError, match="want 33"):
        SampleAttachment.of(b"")


def test_the_attachment_is_the_sdks_too() -> None:
    sdk = pytest.importorskip("zenoh_ros2_sdk.attachment")
    assert SampleAttachment(3, 4, GID).to_bytes() == sdk.Attachment(3, 4, GID).to_bytes()


def test_the_keys_are_those_of_rmw_zenohs_design() -> None:
    # docs/design.md: the topic `chatter` of std_msgs/msg/String, its publisher by the node `talker`
    digest = TYPES.hash("std_msgs/msg/String")
    assert digest == "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    name = dds_type("std_msgs/msg/String")
    assert topic_key(2, "/robot1/chatter", name, digest) == f"2/robot1/chatter/std_msgs::msg::dds_::String_/{digest}"
    talker = GraphEntity(Entity.PUBLISHER, 2, "aac3178e146ba6f1fc6e6a4085e77f21", 0, 10, "/", "talker",
                         "/robot1/chatter", name, digest, RosQos(depth=7))  # fmt: skip
    assert talker.token() == (
        "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MP/%/%/talker/%robot1%chatter/"
        f"std_msgs::msg::dds_::String_/{digest}/::,7:,:,:,,"
    )
    node = GraphEntity(Entity.NODE, 2, "aac3178e146ba6f1fc6e6a4085e77f21", 0, 0, "/", "listener")
    assert node.token() == "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    assert graph_expression(2) == "@ros2_lv/2/**"


NAME = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)
QOS = st.builds(RosQos, st.booleans(), st.booleans(), st.integers(0, 100))


@given(st.sampled_from(list(Entity)[1:]), NAME, NAME, NAME, st.sampled_from(SPOKEN), QOS, st.integers(0, 232))
def test_tokens_are_the_sdks_and_are_read_back(
    entity: Entity, namespace: str, node: str, topic: str, kind: str, qos: RosQos, domain_id: int
) -> None:
    sdk_entity = pytest.importorskip("zenoh_ros2_sdk.entity")
    sdk_keys = pytest.importorskip("zenoh_ros2_sdk.keyexpr")
    sdk_qos = pytest.importorskip("zenoh_ros2_sdk.qos")
    name, digest = resolved(topic, f"/{namespace}"), TYPES.hash(kind)
    ours = GraphEntity(entity, domain_id, "ab12", 1, 2, f"/{namespace}", node, name, dds_type(kind), digest, qos)
    theirs = sdk_entity.EndpointEntity(
        sdk_entity.NodeEntity(domain_id, "ab12", 1, node, f"/{namespace}"), 2, sdk_entity.EntityKind(entity.value),
        name, dds_type(kind), digest, qos.encode(),
    )  # fmt: skip
    assert ours.token() == sdk_keys.endpoint_liveliness_keyexpr(theirs)
    assert GraphEntity.of(ours.token()) == ours and ros_type(ours.type_name) == kind
    assert topic_key(domain_id, name, dds_type(kind), digest) == sdk_keys.topic_keyexpr(
        domain_id, name, dds_type(kind), digest
    )
    decoded = sdk_qos.QosProfile.decode(qos.encode())
    assert (decoded.reliability is sdk_qos.QosReliability.RELIABLE) == qos.reliable
    assert (decoded.durability is sdk_qos.QosDurability.TRANSIENT_LOCAL) == qos.transient_local
    # without a number the depth is rmw_zenoh's default, 42; the SDK takes 10 for it
    if qos.depth not in (0, 42):
        assert decoded.history_depth == qos.depth
    assert RosQos.decode(qos.encode()) == qos


@pytest.mark.parametrize("token", ["@ros2_lv/0/a/0/0/NN", "@ros2_lv/0/a/0/1/MP/%/%/n/%t", "other/0/a/0/0/NN/%/%/n", ""])
def test_what_is_no_token_is_refused(token: str) -> None:
    with pytest.raises(ValueError, match=r"token|parts"):
        GraphEntity.of(token)


def sequence_of(kind: object) -> object:
    return Nodetype.SEQUENCE, (kind, 0)


def test_the_hashes_of_services_are_ros_own() -> None:
    """Known answers: AddTwoInts and rcl_interfaces as ROS 2's own packages install them (Jazzy)."""
    types = RosTypes()
    types.add_service("example_interfaces/srv/AddTwoInts", [("a", "int64"), ("b", "int64")], [("sum", "int64")])
    known = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
    assert types.hash("example_interfaces/srv/AddTwoInts") == known
    name = "rcl_interfaces/srv/GetParameters"
    values = sequence_of((Nodetype.NAME, "rcl_interfaces/msg/ParameterValue"))
    request = sequence_of((Nodetype.BASE, ("string", 0)))
    types.register({f"{name}_Request": [("names", request)], f"{name}_Response": [("values", values)]})
    types.describe_service(name)
    assert types.hash(name) == "RIHS01_bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc"


FIBONACCI = "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n"


def test_the_hashes_of_an_actions_parts_are_ros_own() -> None:
    """Known answers: what rosidl generated for example_interfaces/action/Fibonacci and action_msgs/srv/CancelGoal."""
    types, name = RosTypes(), "example_interfaces/action/Fibonacci"
    actions.add_action(types, name, FIBONACCI)
    known = {
        f"{name}_Goal": "226cb437e4355dcd3e914f930382a3b0cc1da81545bd319ed554e95a03255f51",
        f"{name}_FeedbackMessage": "c1de71afd52e49a89c53d8262366884185bc0a02f78ce051c4e46b0a7fe59bb2",
        f"{name}_SendGoal": "d1a57fb2a4afe8c21e34fb10db206f16ce6729b28531141472df92277c55b557",
        f"{name}_GetResult": "1b0de0d5d29dc955d92f546706568428632771db13ec84c15ec1c1a59f424a57",
        actions.CANCEL: "573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a",
    }
    assert {kind: types.hash(kind) for kind in known} == {kind: f"RIHS01_{digest}" for kind, digest in known.items()}
    with pytest.raises(ValueError, match="1 parts"):
        actions.add_action(types, name, "int32 order")


def test_the_hashes_are_the_sdks() -> None:
    utils = pytest.importorskip("zenoh_ros2_sdk.utils")
    response = "bool success\nstring message\n"
    ours = TYPES.hash("std_srvs/srv/Trigger")
    assert ours == utils.compute_service_type_hash("std_srvs/srv/Trigger", "# nothing", response)
    for name in SPOKEN:
        text, _ = TYPES.store.generate_msgdef(name, ros_version=2)
        own, *parts = text.split("=" * 80 + "\nMSG: ")
        needs = {}
        for part in parts:
            head, body = part.split("\n", 1)
            package, *_, kind = head.split("/")
            needs[f"{package}/msg/{kind}"] = body
        assert TYPES.hash(name) == utils.get_type_hash(name, msg_definition=own, dependencies=needs), name


def test_humble_has_no_hashes() -> None:
    assert RosTypes("humble").hash("std_msgs/msg/String") == "TypeHashNotSupported"


def test_the_cells_clock_is_mapped_to_the_walls_and_back_to_none_before_a_tick() -> None:
    second, clock = 1_000_000_000, WallOfCell()
    assert clock.wall_ns(5) is None
    clock.observe(0, 100 * second, "a")
    assert clock.wall_ns(second) == 101 * second
    clock.observe(second, 101 * second + 5_000_000, "a")  # heard late: what was known stays
    assert clock.wall_ns(2 * second) == 102 * second
    clock.observe(second, 110 * second, "a")  # the cell stood still between commands
    assert clock.wall_ns(second) == 110 * second
    clock.observe(200 * second, 200 * second + 3_000_000, "b")  # a cell whose clock is the wall's
    assert clock.wall_ns(7) == 7
