"""YAML that nobody can have meant is refused by its line, whatever it is; what is meant is read as PyYAML reads it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.config import load_cell
from crosspih_common.config.section import Section
from crosspih_common.errors import ConfigError
from crosspih_common.plain_yaml import MAX_BYTES, yaml_of

BOMB = 'a: &a ["x","x","x","x","x","x","x","x","x"]\n' + "".join(
    f"{name}: &{name} [{','.join(['*' + before] * 9)}]\n" for before, name in zip("abcdefghi", "bcdefghij", strict=True)
)
NOT_MEANT = {
    "cell: {name: a}\ncell: {name: b}": "cell is said twice, here and in line 1",
    "planning:\n  service_patience_s: 20\n  service_patience_s: 1": "service_patience_s is said twice",
    "vision: {looks: 010}": "010 is an octal number",
    "vision: {looks: -007}": "-007 is an octal number",
    "planning: {service_patience_s: 1:30}": "1:30 is minutes or degrees",
    "planning: {service_patience_s: 1:30.5}": "1:30.5 is minutes or degrees",
    "vision: {looks: " + "9" * 5000 + "}": "4300 digits",
    "cell: {name: 2026-02-31}": "day",
    "[" * 900 + "]" * 900: "nested deeper",
    BOMB: "more than 200000 values once its aliases",
    "cell: &a\n  peg: *a": "stands for what it lies in",
}
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**9), 10**9) | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=12,
)


@pytest.mark.parametrize(("text", "said"), NOT_MEANT.items(), ids=range(len(NOT_MEANT)))
def test_what_nobody_means_is_refused(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(yaml.YAMLError) as caught:
        yaml_of(text)
    assert said in str(caught.value)
    (tmp_path / "cell.yaml").write_text(text)
    with pytest.raises(ConfigError, match="is not YAML"):
        load_cell(tmp_path / "cell.yaml")


@given(PLAIN, st.booleans())
@settings(max_examples=60)
def test_what_a_program_writes_comes_back(value: object, flow: bool) -> None:
    assert yaml_of(yaml.safe_dump(value, default_flow_style=flow)) == value


def test_what_a_person_writes_is_read() -> None:
    said = yaml_of("base: &b {x: 0, y: 0.5, z: 1e-3, w: 0x10}\nnext: {<<: *b, x: -0.0}\ntime: '1:30'\nnone:\n")
    assert said == {**yaml.safe_load("base: {x: 0, y: 0.5, z: 1e-3, w: 16}"), "next": said["next"], "time": "1:30",
                    "none": None}  # fmt: skip
    assert said["next"] == {**said["base"], "x": 0.0}
    assert yaml_of("") is None


class Example(Section):
    count: int = 1
    seconds: float | None = None
    on: bool = False
    either: bool | float = 0.0


def test_a_switch_is_no_number() -> None:
    assert Example.model_validate({"count": 2, "seconds": 3, "on": True, "either": True}).either is True
    for name in ("count", "seconds"):
        with pytest.raises(ValueError, match=rf"{name}\n.*want a number, got a switch \(true\)"):
            Example.model_validate({name: True})


def test_a_file_that_is_none_is_refused_at_once(tmp_path: Path) -> None:
    binary, pipe, large, endless = (tmp_path / name for name in ("binary", "pipe", "large", "endless"))
    binary.write_bytes(b"cell: \xff\xfe")
    os.mkfifo(pipe)
    with large.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    endless.symlink_to("/dev/zero")
    said = {binary: "no text in UTF-8: byte 6", pipe: "no regular file", large: f"{MAX_BYTES} are allowed",
            endless: "no regular file", tmp_path: "Is a directory"}  # fmt: skip
    for path, words in said.items():
        with pytest.raises(ConfigError, match=words):
            load_cell(path)
