"""The layouts that are shipped show what there is: topics of the tables, fields of their messages, placed panels.

And what is in a recording: each topic that a panel names, and each field by the schema that the file itself carries.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from google.protobuf import descriptor_pool
from google.protobuf.descriptor import Descriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from typer.testing import CliRunner

from crosspih_common.config.name import DEFAULT_NAME
from crosspih_common.foxglove import viewer_topics
from crosspih_common.foxglove.own_messages import flat_schema
from crosspih_common.keys import topics
from crosspih_common.messages import Image
from services.operator.__main__ import app
from services.operator.recordings.export.layouts import LAYOUTS as FOLDER
from tests.common.test_foxglove import message_of

LAYOUTS = sorted(FOLDER.glob("*.json"))
SAMPLE = Path(__file__).resolve().parents[2] / "docs" / "sample" / "assembly.mcap"
WHERE_THERE_ARE_ANY = "/foxglove/scene/surroundings"  # a cell with nothing around it has no such topic
OURS = {topic.key(DEFAULT_NAME): topic for topic in topics()}
SHOWN = {topic.name: topic for topic in viewer_topics()}
PATH = re.compile(r"(?P<topic>[^.]+)(?P<fields>(\.\w+(\[\d+\])?)*)")


def strings(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        yield from value
        for one in value.values():
            yield from strings(one)
    elif isinstance(value, list):
        for one in value:
            yield from strings(one)
    elif isinstance(value, str):
        yield value


def leaves(tree: Any) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    else:
        yield from leaves(tree["first"])
        yield from leaves(tree["second"])


def is_number_or_text(topic: str, fields: list[str]) -> bool:
    """Whether a viewer finds a value there that it can plot, or colour a state by."""
    if topic in SHOWN:
        return _of_protobuf(message_of(SHOWN[topic]).DESCRIPTOR, fields)
    return _of_json(flat_schema(OURS[topic].type), fields)


def _of_json(schema: Any, fields: list[str]) -> bool:
    for field in fields:
        name, _, index = field.partition("[")
        schema = schema["properties"][name]
        if index:
            schema = schema["items"]
    return schema["type"] in ("number", "integer", "boolean", "string")


def _of_protobuf(descriptor: Descriptor, fields: list[str]) -> bool:
    for field in fields[:-1]:
        below = descriptor.fields_by_name[field].message_type
        assert below is not None
        descriptor = below
    return descriptor.fields_by_name[fields[-1]].message_type is None


@pytest.mark.parametrize("path", LAYOUTS, ids=lambda path: path.stem)
def test_a_layout_shows_what_there_is(path: Path) -> None:
    layout = json.loads(path.read_text(encoding="utf-8"))
    assert set(leaves(layout["layout"])) == set(layout["configById"])
    named = {text for text in strings(layout["configById"]) if text.startswith(("/foxglove/", "crosspih/"))}
    for text in named:
        match = PATH.fullmatch(text)
        assert match is not None and (match["topic"] in SHOWN or match["topic"] in OURS), text
        fields = [field for field in match["fields"].split(".") if field]
        assert not fields or is_number_or_text(match["topic"], fields), text
    for panel in layout["configById"].values():
        picture = panel.get("imageMode", {}).get("imageTopic")
        assert picture is None or OURS[picture].type is Image


def shown_wrongly(layout: Path, recording: Path) -> list[str]:
    """What a layout names and a recording's own channels and schemas have not."""
    with recording.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    schemas = {
        channel.topic: summary.schemas[channel.schema_id]
        for number, channel in summary.channels.items()
        if summary.statistics.channel_message_counts.get(number)
    }
    wrong = []
    named = set(strings(json.loads(layout.read_text(encoding="utf-8"))["configById"])) - {WHERE_THERE_ARE_ANY}
    for text in sorted(text for text in named if text.startswith(("/foxglove/", "crosspih/"))):
        match = PATH.fullmatch(text)
        schema = schemas.get(match["topic"]) if match is not None else None
        if match is None or schema is None:
            wrong.append(text)
            continue
        fields = [field for field in match["fields"].split(".") if field]
        if not fields:
            continue
        if schema.encoding == "protobuf":
            pool = descriptor_pool.DescriptorPool()
            for file in FileDescriptorSet.FromString(schema.data).file:
                pool.Add(file)
            found = _of_protobuf(pool.FindMessageTypeByName(schema.name), fields)
        else:
            found = _of_json(json.loads(schema.data), fields)
        if not found:
            wrong.append(text)
    return wrong


def test_every_topic_and_field_of_the_layouts_is_in_the_sample(tmp_path: Path) -> None:
    run = CliRunner().invoke(app, ["recording", "export", "layouts", str(SAMPLE), str(tmp_path)])
    assert run.exit_code == 0, run.output
    assert sorted(path.name for path in tmp_path.iterdir()) == [path.name for path in LAYOUTS]
    assert {path.name: shown_wrongly(path, SAMPLE) for path in sorted(tmp_path.iterdir())} == {
        path.name: [] for path in LAYOUTS
    }
    # of another cell's name nothing of ours is there: the test would find a topic that is missing
    assert "crosspih/cell1/planning/phase.phase" in shown_wrongly(LAYOUTS[0], SAMPLE)


def test_the_assembly_has_every_kind_of_panel_and_the_full_rate_of_the_sensor() -> None:
    layout = json.loads(next(path for path in LAYOUTS if path.stem == "assembly").read_text(encoding="utf-8"))
    kinds = {name.split("!")[0] for name in layout["configById"]}
    assert {"3D", "Image", "Plot", "StateTransitions", "RosOut"} <= kinds
    assert "/foxglove/wrench/raw.force.x" in set(strings(layout["configById"]))
