"""The JSON Schema that `crosspih keys --schema` writes says what the codec accepts: no more, no less."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

from crosspih_common.bus.codec import decode, encode, label_of
from crosspih_common.errors import ContractError
from crosspih_common.keys import commands, topics
from crosspih_common.messages import Image, Message
from services.operator.cli.commands import app
from services.operator.contract.schema import INDEX, image_proto, index, message_schema, schema_file, types

MESSAGES: list[type[Message]] = [kind for kind in types() if issubclass(kind, Message)]
Json = Any


# control characters, and what else a terminal obeys, are no part of any text on the wire (docs/wire.md)
PLAIN = st.characters(exclude_categories=("Cc", "Cf", "Cs", "Zl", "Zp"))
# what no JSON schema can ask of several numbers together: it is told by `format`
LAWFUL: dict[str, st.SearchStrategy[Json]] = {
    "unit_quaternion": st.sampled_from([[0.0, 0.0, 0.0, 1.0], [0.5, -0.5, 0.5, -0.5], [0.6, 0.0, 0.8, 0.0]]),
    "direction": st.sampled_from([[0.0, 0.0, -1.0], [300.0, 4.0, 0.1]]),
    "standard_deviations": st.lists(st.floats(0.0, 1e3), min_size=6, max_size=6),
    "covariance": st.lists(st.floats(1e-9, 1.0), min_size=6, max_size=6).map(
        lambda variances: [variances[at // 7] if at % 7 == 0 else 0.0 for at in range(36)]
    ),
}


def values(schema: Json, definitions: Json) -> st.SearchStrategy[Json]:
    """Anything that a schema allows, of the few forms that our schemas have."""
    if "$ref" in schema:
        return values(definitions[schema["$ref"].rsplit("/", 1)[-1]], definitions)
    if "anyOf" in schema:
        return st.one_of(*(values(option, definitions) for option in schema["anyOf"]))
    if schema.get("format") in LAWFUL:
        return LAWFUL[schema["format"]]
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    if "const" in schema:
        return st.just(schema["const"])
    kind = schema["type"]
    if kind == "null":
        return st.none()
    if kind == "boolean":
        return st.booleans()
    if "pattern" in schema:
        return st.from_regex(schema["pattern"], fullmatch=True).filter(lambda text: len(text) <= schema["maxLength"])
    if kind == "string":
        return st.text(PLAIN, min_size=schema.get("minLength", 0), max_size=min(schema.get("maxLength", 12), 12))
    if kind == "integer":
        return st.integers(*_bounds(schema, 1))
    if kind == "number":
        low, high = _bounds(schema, 1e-3)
        return st.floats(low, high, allow_nan=False)
    if kind == "array":
        least = schema.get("minItems", 0)
        return st.lists(
            values(schema["items"], definitions), min_size=least, max_size=max(least, min(schema.get("maxItems", 2), 2))
        )
    if "properties" not in schema:
        inner = schema.get("additionalProperties", {"type": "number"})
        return st.dictionaries(st.text(PLAIN, max_size=4), values(inner, definitions), max_size=2)
    wanted = set(schema.get("required", ()))
    fields = {name: values(field, definitions) for name, field in schema["properties"].items()}
    return st.fixed_dictionaries(
        {name: field for name, field in fields.items() if name in wanted},
        optional={name: field for name, field in fields.items() if name not in wanted},
    )


def _bounds(schema: Json, margin: float) -> tuple[Any, Any]:
    low, high = schema.get("minimum"), schema.get("maximum")
    if low is None:
        low = schema["exclusiveMinimum"] + margin if "exclusiveMinimum" in schema else -1000
    if high is None:
        high = schema["exclusiveMaximum"] - margin if "exclusiveMaximum" in schema else low + 1000
    return low, high


def accepted(kind: type[Message], document: Json) -> bool:
    try:
        decode(kind, json.dumps(document).encode(), label_of(kind), "k")
    except ContractError:
        return False
    return True


def with_lawful_lenses(value: Json) -> Json:
    """How many numbers of distortion a lens has depends on its model: a rule between fields, said by no schema here."""
    if isinstance(value, dict):
        found = {name: with_lawful_lenses(part) for name, part in value.items()}
        lens = {"distortion": [], "distortion_model": "none"}
        return {**found, **lens} if lens.keys() & found.keys() else found
    return [with_lawful_lenses(part) for part in value] if isinstance(value, list) else value


def spoilt(document: dict[str, Json], schema: Json) -> list[dict[str, Json]]:
    """Copies with one mistake each: a field more, one less, one of another type, a bound passed, a length changed."""
    copies = [{**document, "unheard_of": 1}]
    for name, field in schema["properties"].items():
        if name in schema.get("required", ()):
            copies.append({key: value for key, value in document.items() if key != name})
        copies.append({**document, name: {"no": ["such", "thing"]}})
        kind = field.get("type")
        if kind in ("number", "integer"):
            for bound, beyond in (("minimum", -1), ("exclusiveMinimum", 0), ("maximum", 1), ("exclusiveMaximum", 0)):
                if bound in field:
                    copies.append({**document, name: field[bound] + beyond})
            copies.append({**document, name: "much"})
        if kind == "array" and "maxItems" in field and field["maxItems"] < 100 and document.get(name):
            copies.append({**document, name: [document[name][0]] * (field["maxItems"] + 1)})
        if kind == "array" and "minItems" in field:
            copies.append({**document, name: document.get(name, [])[: field["minItems"] - 1]})
    return copies


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
@settings(max_examples=5)
@given(data=st.data())
def test_what_the_schema_allows_the_codec_takes_and_what_it_sends_is_allowed(
    kind: type[Message], data: st.DataObject
) -> None:
    schema = message_schema(kind)
    Draft202012Validator.check_schema(schema)
    validator = Draft202012Validator(schema)
    document = with_lawful_lenses(data.draw(values(schema, schema.get("$defs", {}))))
    assert validator.is_valid(document)
    assert list(schema["properties"])[:2] == ["stamp_ns", "seq"]  # the recorder reads the stamp without decoding
    sent = encode(decode(kind, json.dumps(document).encode(), label_of(kind), "k"))
    assert [error.message for error in validator.iter_errors(json.loads(sent))] == []
    for copy in spoilt(json.loads(sent), schema):
        assert not validator.is_valid(copy), copy
        assert not accepted(kind, copy), copy


def test_the_folder_holds_every_type_and_an_index_of_every_key(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["keys", "--schema", str(tmp_path / "new" / "schemas")])
    assert done.exit_code == 0, done.output
    folder = tmp_path / "new" / "schemas"
    names = {path.name for path in folder.iterdir()}
    assert names == {INDEX, *(schema_file(kind) for kind in types())}
    assert [line for line in done.output.splitlines() if line.endswith(".json")], done.output
    read = json.loads((folder / INDEX).read_text(encoding="utf-8"))
    assert read == index()
    rows = {row["path"]: row for row in read["keys"]}
    assert rows.keys() == {*(one.path for one in topics()), *(one.path for one in commands())}
    carried = [part for row in rows.values() for part in ([row] if "label" in row else [row["request"], row["reply"]])]
    assert {part["schema"] for part in carried} == names - {INDEX}
    for part in carried:
        if part["schema"].endswith(".json"):
            schema = json.loads((folder / part["schema"]).read_text(encoding="utf-8"))
            name, _, version = part["label"].partition("/")
            assert schema["$id"] == f"urn:{name}:{version}" and schema["title"] == name
    assert (folder / schema_file(Image)).read_text(encoding="utf-8") == image_proto()


def test_a_folder_that_cannot_be_is_named_with_a_mend(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    done = CliRunner().invoke(app, ["keys", "--schema", str(tmp_path / "file" / "in")])
    assert done.exit_code == 1
    assert "--schema" in done.output and "another folder" in done.output
