"""The contract: every message survives the wire, and the key table is whole."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from crosspih_common import messages
from crosspih_common.bus.codec import (
    decode,
    encode,
    encode_stamped,
    label_of,
    label_with_seq,
    split_label,
    stamper_of,
    validator_without_text,
)
from crosspih_common.errors import ContractError
from crosspih_common.keys import ALL, Topic, commands, topics
from crosspih_common.messages import ContactState, Dwell, Image, JointKnot, JointState, Message, PoseData, Severity
from crosspih_common.messages.images import ENCODINGS

MESSAGES = [
    value
    for name in messages.__all__
    if isinstance(value := getattr(messages, name), type) and issubclass(value, Message) and value is not Message
]
finite = st.floats(-1e6, 1e6)


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
def test_every_message_travels(kind: type[Message]) -> None:
    used = {topic.type for topic in topics()}
    assert kind in used or kind.__name__ in {"RawReading"}, f"{kind.__name__} stands on no key"


@given(st.tuples(*[finite] * 6), st.tuples(*[finite] * 6), st.integers(0, 2**62), st.integers(0, 2**31))
def test_round_trip_is_exact(joints: tuple[float, ...], speeds: tuple[float, ...], stamp: int, seq: int) -> None:
    sent = JointState(stamp_ns=stamp, seq=seq, joints_rad=joints, speeds_rad_s=speeds)
    assert decode(JointState, encode(sent), label_with_seq(JointState, seq), "k") == sent


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
def test_every_message_begins_with_its_stamp_and_number(kind: type[Message]) -> None:
    assert list(kind.model_fields)[:2] == ["stamp_ns", "seq"]


@given(
    st.integers(-1, 2**62), st.just(-1) | st.integers(-1, 2**53 - 1), st.integers(0, 2**62) | st.none(),
    st.integers(0, 2**53 - 1),
)  # fmt: skip
def test_stamping_the_bytes_is_stamping_a_copy(own_stamp: int, own_seq: int, stamp: int | None, seq: int) -> None:
    stamp = max(own_stamp, 0) if stamp is None else stamp  # a publisher leaves a stamp that there is
    for value in (
        Dwell(stamp_ns=own_stamp, seq=own_seq, duration_s=0.5),
        messages.StopMotion(stamp_ns=own_stamp, seq=own_seq),
        messages.Event(stamp_ns=own_stamp, seq=own_seq, service="a", severity=Severity.INFO, code="b", text='"seq":-1'),
    ):
        wanted = encode(value.model_copy(update={"stamp_ns": stamp, "seq": seq}))
        assert encode_stamped(value, stamp, seq) == wanted
        assert stamper_of(type(value))(value, stamp, seq) == wanted
        assert (value.stamp_ns, value.seq) == (own_stamp, own_seq)


def _has_free_text(schema: Any) -> bool:
    """Of a JSON schema, made by pydantic in another way than what it validates by."""
    if isinstance(schema, dict):
        if schema.get("type") == "string" and "enum" not in schema and "const" not in schema:
            return True
        if not {"type", "anyOf", "allOf", "$ref", "properties", "enum", "const"} & set(schema) and "title" in schema:
            return True  # anything at all
    parts = schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ()
    return any(map(_has_free_text, parts))


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
def test_where_no_text_is_looked_at_there_can_be_none(kind: type[Message]) -> None:
    if validator_without_text(kind) is not None:
        assert not _has_free_text(kind.model_json_schema())


def test_of_which_texts_are_looked_at() -> None:
    assert (
        validator_without_text(JointState) is not None and validator_without_text(messages.RawWrenchBatch) is not None
    )
    assert validator_without_text(messages.Event) is None and validator_without_text(Image) is None


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("padding", [0, 6])
def test_every_encoding_is_read_with_and_without_padding(encoding: str, padding: int) -> None:
    kind, channels = ENCODINGS[encoding]
    shape = (4, 6, 3) if channels == 3 else (4, 6)
    pixels = np.random.default_rng(0).integers(0, np.iinfo(kind).max, shape, dtype=np.uint16)
    row = pixels.reshape(4, -1).astype(kind).view(np.uint8)
    message = RawImage(width=6, height=4, encoding=encoding, step=row.shape[1] + padding)
    message.data = np.hstack([row, np.full((4, padding), 77, dtype=np.uint8)]).tobytes()
    back = decode(Image, message.SerializeToString(), label_of(Image), "k")
    assert np.array_equal(back.pixels, pixels) and back.pixels.dtype.isnative
    assert back.encoding == ("mono16" if encoding == "mono16be" else encoding)
    again = decode(Image, encode(back), label_of(Image), "k")
    assert np.array_equal(again.pixels, pixels) and again.encoding == back.encoding


@pytest.mark.parametrize(
    ("shape", "kind", "encoding"),
    [
        ((4, 4), np.uint8, "rgb8"), ((4, 4, 3), np.uint8, "mono8"), ((4, 4), np.uint16, "mono8"),
        ((4, 4, 4), np.uint8, ""), ((4, 4), np.float32, ""), ((4, 4), np.uint8, "yuv422"), ((4, 4, 3), np.uint16, ""),
    ],
)  # fmt: skip
def test_pixels_that_are_not_what_the_encoding_says_are_no_image(shape: Any, kind: Any, encoding: str) -> None:
    with pytest.raises(ValueError, match="encodings: mono8, mono16"):
        Image("camera_left", np.zeros(shape, kind), encoding=encoding)


@given(st.integers(1, 40), st.integers(1, 30), st.booleans(), st.integers(0, 2**60))
def test_images_round_trip(height: int, width: int, colour: bool, stamp: int) -> None:
    shape = (height, width, 3) if colour else (height, width)
    pixels = np.random.default_rng(height * 41 + width).integers(0, 256, shape, dtype=np.uint8)
    back = decode(Image, encode(Image("camera_left", pixels, stamp)), label_with_seq(Image, 7), "k")
    assert np.array_equal(back.pixels, pixels)
    assert (back.frame, back.stamp_ns, back.seq) == ("camera_left", stamp, 7)


@given(st.binary(max_size=200), st.text(max_size=40))
def test_any_bytes_are_a_contract_error_and_nothing_else(payload: bytes, label: str) -> None:
    for kind in (JointState, Image):
        for name in (label, label_of(kind)):
            try:
                decode(kind, payload, name, "some/key")
            except ContractError as error:
                assert "some/key" in str(error) or kind is Image


def test_a_wrong_type_names_both() -> None:
    with pytest.raises(ContractError, match=r"got crosspih\.Dwell/1, want crosspih\.JointState/1"):
        decode(JointState, encode(Dwell(duration_s=1.0)), label_of(Dwell), "k")


def test_a_wrong_version_names_both() -> None:
    with pytest.raises(ContractError, match=r"got crosspih\.JointState/2, want crosspih\.JointState/1"):
        decode(JointState, b"{}", "crosspih.JointState/2", "k")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_no_message_holds_what_is_not_finite(value: float) -> None:
    with pytest.raises(ValidationError, match="duration_s"):
        Dwell(duration_s=value)


def test_messages_are_frozen_and_know_their_fields() -> None:
    state = ContactState(case="1-2-2", n_z0=0.27, confidence=0.9)
    with pytest.raises(ValidationError):
        state.case = "1-1-1"  # type: ignore[misc]
    with pytest.raises(ValidationError, match="colour"):
        ContactState(case=None, n_z0=0.0, confidence=0.0, colour="red")  # type: ignore[call-arg]


def test_pose_round_trip() -> None:
    pose = PoseData(position_m=(1.0, 2.0, 3.0), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
    assert PoseData.of(pose.pose()) == pose


def test_labels_carry_the_count() -> None:
    assert split_label(label_with_seq(JointState, 12)) == ("crosspih.JointState/1", 12)
    assert split_label("crosspih.JointState/1") == ("crosspih.JointState/1", -1)


def test_keys_are_distinct_and_below_the_cell() -> None:
    keys = [topic.key("a") for topic in topics()] + [command.key("a") for command in commands()]
    assert len(set(keys)) == len(keys)
    assert all(key.startswith("crosspih/a/") for key in keys)


def _services(topic: Topic[Any]) -> set[str]:
    return {topic.publisher, *topic.readers} - {"{service}"}


def test_every_key_says_who_sends_and_who_reads() -> None:
    for topic in topics():
        assert _services(topic) <= set(ALL), topic.path
        assert topic.readers and topic.doc
    for command in commands():
        assert {command.server, *command.callers} <= set(ALL), command.path


def test_truth_is_for_scoring_only() -> None:
    truth = next(topic for topic in topics() if topic.path == "simulation/truth")
    assert set(truth.readers) == {"recorder", "operator"}


def test_joints_are_as_many_as_the_arm_has() -> None:
    seven = (0.1,) * 7
    knot = JointKnot(time_s=0.0, joints_rad=seven)
    assert knot.speeds_rad_s == knot.accelerations_rad_s2 == (0.0,) * 7
    assert JointKnot.model_validate_json(knot.model_dump_json()) == knot
    assert JointState(joints_rad=seven, speeds_rad_s=seven).joints_rad == seven
    for count in (5, 8):
        with pytest.raises(ValidationError, match="joints_rad"):
            JointKnot(time_s=0.0, joints_rad=(0.0,) * count)
    with pytest.raises(ValidationError, match="speeds_rad_s has 6 numbers, joints_rad has 7; give as many"):
        JointState(joints_rad=seven, speeds_rad_s=(0.0,) * 6)
    with pytest.raises(ValidationError, match="accelerations_rad_s2 has 7 numbers, joints_rad has 6"):
        JointKnot(time_s=0.0, joints_rad=(0.0,) * 6, accelerations_rad_s2=seven)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("padding", [0, 5])
def test_rows_with_padding_are_read_without_it(channels: int, padding: int) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (4, 7) if channels == 1 else (4, 7, 3), dtype=np.uint8)
    row = 7 * channels
    message = RawImage(width=7, height=4, encoding="mono8" if channels == 1 else "rgb8", step=row + padding)
    padded = np.hstack([pixels.reshape(4, row), np.full((4, padding), 77, dtype=np.uint8)])
    message.data = padded.tobytes()
    back = decode(Image, message.SerializeToString(), label_of(Image), "k")
    assert np.array_equal(back.pixels, pixels)
    for step, data in ((row - 1, message.data), (row + padding, message.data[:-1]), (0, message.data)):
        message.step, message.data = step, data
        with pytest.raises(ContractError, match=f"step {step} "):
            decode(Image, message.SerializeToString(), label_of(Image), "k")
        message.data = padded.tobytes()
