"""Schemas of our own messages that Foxglove and Lichtblick can read.

Their JSON schema parser knows boolean, string, number, integer, objects that have `properties`, and arrays of those. It
throws on `$ref`, `anyOf`, `prefixItems` and arrays of arrays, and then shows nothing of the channel. So references are
written out, an Optional is described as what it is when present, and arrays of arrays are left out of the schema (the
data still holds them, and both viewers show them in their raw message panels).
"""

from __future__ import annotations

import json
from typing import Any

from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from crosspih_common.foxglove.schemas import descriptor_set
from crosspih_common.messages import Image, Message
from crosspih_common.messages.images import IMAGE_TYPE

JsonSchema = dict[str, Any]
_SCALARS = ("boolean", "string", "number", "integer")
_KEPT = ("description", "enum", "minItems", "maxItems", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")


def flat_schema(model: type[Message]) -> JsonSchema:
    """The JSON schema of a message, flattened for the viewers."""
    full = model.model_json_schema(mode="serialization")
    flat = _flatten(full, full.get("$defs", {}))
    if flat is None:
        raise TypeError(f"{model.__name__} is no object to a viewer")
    return {"title": model.type_name(), **flat}


def _resolve(schema: JsonSchema, definitions: dict[str, JsonSchema]) -> JsonSchema:
    """Resolve references and reduce an Optional to its one alternative; other entries are kept."""
    beside = {name: value for name, value in schema.items() if name in _KEPT}
    if "$ref" in schema:
        return {**_resolve(definitions[schema["$ref"].rsplit("/", 1)[-1]], definitions), **beside}
    for union in ("anyOf", "oneOf"):
        if union in schema:
            present = [_resolve(option, definitions) for option in schema[union] if option.get("type") != "null"]
            kinds = {option.get("type") for option in present}
            if len(present) == 1:
                return {**present[0], **beside}
            if len(kinds) == 1 and kinds <= set(_SCALARS):  # as one of our strategies, or the name of one's own
                return {"type": kinds.pop(), **beside}
            raise TypeError(f"a field of several types cannot be shown: {schema}")
    if "allOf" in schema and len(schema["allOf"]) == 1:
        return {**_resolve(schema["allOf"][0], definitions), **beside}
    return schema


def _flatten(schema: JsonSchema, definitions: dict[str, JsonSchema]) -> JsonSchema | None:
    """The flat form, or None if the viewers cannot show it."""
    schema = _resolve(schema, definitions)
    kept = {name: schema[name] for name in _KEPT if name in schema}
    kind = schema.get("type")
    if kind in _SCALARS:
        return {"type": kind, **kept}
    if kind == "object":
        fields = {name: _flatten(field, definitions) for name, field in schema.get("properties", {}).items()}
        return {"type": "object", **kept, "properties": {n: field for n, field in fields.items() if field is not None}}
    if kind == "array":
        options = schema.get("prefixItems")
        items = _flatten(schema.get("items") or (options[0] if options else {}), definitions)
        if items is None or items["type"] == "array":
            return None
        return {"type": "array", **kept, "items": items}
    return None


def channel_schema(kind: type[Any]) -> tuple[str, str, str, bytes]:
    """(schema name, schema encoding, message encoding, schema bytes) of a message type on the bus."""
    if issubclass(kind, Image):
        return IMAGE_TYPE, "protobuf", "protobuf", descriptor_set(RawImage.DESCRIPTOR.file)
    return kind.type_name(), "jsonschema", "json", json.dumps(flat_schema(kind)).encode()
