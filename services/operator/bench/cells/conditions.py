"""Differences from the default cell: named overrides of the cell's file. Pure."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, Field

from crosspih_common.config.drawing import peg_section
from crosspih_common.errors import ConfigError
from crosspih_common.plain_yaml import yaml_of

DEFAULT_PEG = "cross"


class Condition(BaseModel):
    """A cell that differs from the default by `overrides`, in the fields of a cell's file.

    For instance {"cell": {"hole": {"clearance_m": 0.0002}}}. Two conditions with the same overrides are the same cell,
    whatever their names.
    """

    model_config = ConfigDict(frozen=True)

    name: str = "default"
    overrides: dict[str, Any] = Field(default_factory=dict)


def merged(base: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """A deep copy of `base` with every leaf of `overrides` inserted; mappings are merged, everything
    else is replaced.
    """
    result = copy.deepcopy(dict(base))
    for name, value in overrides.items():
        known = result.get(name)
        if isinstance(value, Mapping):
            result[name] = merged(known if isinstance(known, Mapping) else {}, value)
        else:
            result[name] = copy.deepcopy(value)
    return result


def condition_of(settings: Sequence[str]) -> Condition:
    """A condition from settings as a person types them: section.name.name=value, the value in YAML.

    Raises ConfigError for a setting that is not valid.
    """
    overrides: dict[str, Any] = {}
    for setting in settings:
        path, equals, text = setting.partition("=")
        names = path.split(".")
        if not equals or len(names) < 2 or not all(names):
            raise ConfigError(f"--set {setting}: want section.name=value, such as cell.hole.clearance_m=0.0002")
        try:
            value = yaml_of(text)
        except yaml.YAMLError:
            raise ConfigError(f"--set {setting}: {text!r} is not a value in YAML") from None
        for name in reversed(names):
            value = {name: value}
        overrides = merged(overrides, value)
    return Condition(name=" ".join(settings) or "default", overrides=overrides)


def peg_overrides(peg: str) -> dict[str, Any]:
    """The fields of a cell's file for a peg by its name or by its drawing's file; nothing for the cell's own."""
    return {} if peg == DEFAULT_PEG else {"cell": {"peg": peg_section(peg)}}


def cell_content(base_text: str, condition: Condition, peg: str = DEFAULT_PEG) -> dict[str, Any]:
    """The content of the cell's file under a condition. Raises ConfigError when the file is no mapping."""
    base = yaml_of(base_text) or {}
    if not isinstance(base, dict):
        raise ConfigError(f"the cell's file wants a mapping of sections, got {type(base).__name__}")
    # a section without content is None in YAML
    base = {name: {} if section is None else section for name, section in base.items()}
    if peg != DEFAULT_PEG and "cell" in base:
        # another peg keeps no field of the cell's own peg
        base["cell"] = {name: value for name, value in base["cell"].items() if name != "peg"}
    return merged(merged(base, peg_overrides(peg)), condition.overrides)
