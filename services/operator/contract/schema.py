"""JSON Schema (2020-12) of every message, one file per type, and an index from each key to them.

`crosspih_common/foxglove/own_messages.py` simplifies the schemas for viewers. These are complete: they describe exactly
what the codec accepts, references and null included.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from crosspih_common.bus.codec import label_of
from crosspih_common.keys import ALIVE_PATH, ROOT, Command, Qos, Topic, commands, topics
from crosspih_common.messages import Image, Message
from crosspih_common.messages.images import IMAGE_TYPE
from crosspih_common.refusals import REFUSALS

JsonSchema = dict[str, Any]
DIALECT = "https://json-schema.org/draft/2020-12/schema"
INDEX = "index.json"
# the types of an image's fields, by protobuf's number for them
_PROTO_TYPES = {7: "fixed32", 9: "string", 12: "bytes"}


def message_schema(kind: type[Message]) -> JsonSchema:
    """The schema of a message's payload. `$id` is the label that is sent with it, as a URN."""
    schema = kind.model_json_schema(mode="validation")
    return {"$schema": DIALECT, "$id": f"urn:{label_of(kind).replace('/', ':')}", **schema, "title": kind.type_name()}


def image_proto() -> str:
    """The protobuf definition of an image, from the descriptor that the codec uses."""
    descriptor = RawImage.DESCRIPTOR
    lines = ['syntax = "proto3";', 'import "google/protobuf/timestamp.proto";', "package foxglove;", ""]
    lines.append(f"message {descriptor.name} {{")
    for field in sorted(descriptor.fields, key=lambda one: one.number):
        kind = field.message_type.full_name if field.message_type is not None else _PROTO_TYPES[field.type]
        lines.append(f"  {kind} {field.name} = {field.number};")
    return "\n".join([*lines, "}"]) + "\n"


def schema_file(kind: type[Any]) -> str:
    """The name of a type's file."""
    return f"{IMAGE_TYPE}.proto" if issubclass(kind, Image) else f"{kind.type_name()}.json"


def types() -> list[type[Any]]:
    """Every type that is sent, by name."""
    return sorted({topic.type for topic in topics()}, key=lambda kind: str(kind.__name__))


def _carried(kind: type[Any]) -> dict[str, str]:
    return {"label": label_of(kind), "schema": schema_file(kind)}


def _topic_row(topic: Topic[Any]) -> dict[str, Any]:
    return {
        "path": topic.path,
        "kind": topic.kind.value,
        "direction": "publish",
        **_carried(topic.type),
        "publisher": topic.publisher,
        "readers": list(topic.readers),
        "rate_hz": topic.rate_hz,
        "advanced": topic.qos is Qos.RECOVER,
        "doc": topic.doc,
    }


def _command_row(command: Command[Any, Any]) -> dict[str, Any]:
    return {
        "path": command.path,
        "kind": "command",
        "direction": "query",
        "request": _carried(command.request),
        "reply": _carried(command.reply),
        "server": command.server,
        "callers": list(command.callers),
        "echoes": [command.request_echo.path, command.reply_echo.path],
        "doc": command.doc,
    }


def index() -> JsonSchema:
    """Each key with its message, kind, label and direction; file paths are below `prefix`."""
    return {
        "prefix": f"{ROOT}/{{cell}}/",
        "label": "<type>/<version>, and for samples a space and seq: the attachment",
        "alive": ALIVE_PATH,
        "refusal": {"payload": "<code>\\n<text>, UTF-8", "codes": REFUSALS},
        "keys": [*(_command_row(command) for command in commands()), *(_topic_row(topic) for topic in topics())],
    }


def write_schemas(folder: Path) -> list[Path]:
    """Write a file for each type and the index; returns the paths. Raises OSError where the folder cannot be made."""
    folder.mkdir(parents=True, exist_ok=True)
    texts = {
        schema_file(kind): image_proto() if issubclass(kind, Image) else _json(message_schema(kind)) for kind in types()
    }
    written = []
    for name, text in {**texts, INDEX: _json(index())}.items():
        path = folder / name
        path.write_text(text, encoding="utf-8")
        written.append(path)
    return written


def _json(value: JsonSchema) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"
