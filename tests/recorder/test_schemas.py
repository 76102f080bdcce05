"""Every topic's schema is one that Foxglove and Lichtblick parse."""

from __future__ import annotations

import json
from typing import Any

import pytest
from google.protobuf import descriptor_pool
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from crosspih_common.foxglove.own_messages import channel_schema, flat_schema
from crosspih_common.keys import Topic, topics
from crosspih_common.messages import AssemblyResult, GuardedMoveOutcome, Image, RawWrenchBatch

MESSAGE_TOPICS = [topic for topic in topics() if topic.type is not Image]


def viewer_parses(schema: dict[str, Any], path: str) -> None:
    """The rules of the viewers' parseJsonSchema: what it throws on fails here."""
    assert schema["type"] == "object", path
    for name, field in schema["properties"].items():  # it iterates without asking whether there are any
        where = f"{path}.{name}"
        assert not {"$ref", "anyOf", "oneOf", "allOf", "prefixItems"} & field.keys(), where
        kind = field["type"]
        if kind == "array":
            kind = field["items"]["type"]
            assert not {"$ref", "anyOf", "oneOf", "allOf", "prefixItems"} & field["items"].keys(), where
            field = field["items"]
            assert kind != "array", where
        assert kind in ("boolean", "string", "number", "integer", "object"), where
        if kind == "object":
            viewer_parses(field, where)


@pytest.mark.parametrize("topic", MESSAGE_TOPICS, ids=lambda topic: topic.path)
def test_every_schema_is_flat(topic: Topic[Any]) -> None:
    name, encoding, message_encoding, data = channel_schema(topic.type)
    assert (name, encoding, message_encoding) == (topic.type.type_name(), "jsonschema", "json")
    for word in (b"$ref", b"$defs", b"anyOf", b"oneOf", b"prefixItems", b'"null"'):
        assert word not in data
    schema = json.loads(data)
    viewer_parses(schema, topic.path)
    # nothing is forgotten but arrays of arrays, which the viewers cannot describe
    assert set(topic.type.model_fields) - set(schema["properties"]) <= {"samples", "wrenches", "wrench_sds"}


def test_optional_fields_are_described_as_what_they_are_when_present() -> None:
    fields = flat_schema(GuardedMoveOutcome)["properties"]
    assert fields["travel_first_contact_m"]["type"] == "number"
    assert fields["pose_base_peg_observed"]["properties"]["position_m"]["items"]["type"] == "number"
    assert fields["wrench_observed_raw"]["items"]["type"] == "number"
    assert flat_schema(AssemblyResult)["properties"]["failure"]["type"] == "string"


def test_arrays_of_arrays_are_left_out() -> None:
    assert "samples" not in flat_schema(RawWrenchBatch)["properties"]


def test_an_image_schema_stands_alone() -> None:
    name, encoding, message_encoding, data = channel_schema(Image)
    assert (name, encoding, message_encoding) == ("foxglove.RawImage", "protobuf", "protobuf")
    pool = descriptor_pool.DescriptorPool()
    for file in FileDescriptorSet.FromString(data).file:  # imports come first, or this raises
        pool.Add(file)
    assert pool.FindMessageTypeByName(name).fields_by_name["data"] is not None
