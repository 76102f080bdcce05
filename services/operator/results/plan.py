"""The list of the sections of docs/results.md: one entry per command. To add a result, add an entry to plan.yaml."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Mapping
from itertools import product
from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from crosspih_common.errors import ConfigError
from crosspih_common.modules import module_command
from crosspih_common.plain_yaml import text_of_file, yaml_of

PLAN = Path(__file__).with_name("plan.yaml")


def _filled(text: str, values: Mapping[str, str]) -> str:
    for name, value in values.items():
        text = text.replace(f"{{{name}}}", value)
    return text


class PlannedSection(BaseModel):
    """One section of the page."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9-]*$", description="its files are called so")
    title: str
    says: str = Field(default="", description="what to look for, above the command")
    command: str = Field(description="crosspih ... or python -m ...; {out} is the folder for its pictures")
    quick: str = Field(default="", description="options that --quick adds: a small run that only shows that it works")
    in_cells: bool = Field(default=True, description="takes --cells, --executor, --ray-address")
    has_json: bool = Field(default=True, description="can print --json; done in a second call, which finds all stored")

    each: dict[str, list[str]] = Field(
        default_factory=dict,
        description="one section for each value, put in for {its name} in title, command and quick",
    )

    def expanded(self) -> list[PlannedSection]:
        """The entries that this one expands to: one for each combination of the values in `each`."""
        if not self.each:
            return [self]
        found = []
        for values in product(*self.each.values()):
            said = dict(zip(self.each, values, strict=True))
            texts = {field: _filled(getattr(self, field), said) for field in ("title", "says", "command", "quick")}
            name = "-".join([self.name, *(re.sub(r"[^a-z0-9]+", "-", value.lower()) for value in values)])
            found.append(self.model_copy(update={**texts, "name": name, "each": {}}))
        return found

    def shown(self, out: str, extra: tuple[str, ...] = ()) -> str:
        """The command as a person types it."""
        return shlex.join([*shlex.split(self.command.replace("{out}", out)), *extra])


def arguments(command: str) -> list[str]:
    """The arguments of a command that is written as a person types it. Raises ConfigError for one that is not of this
    project.
    """
    words = shlex.split(command)
    if words[:1] == ["crosspih"]:
        return module_command("services.operator", *words[1:])
    if words[:2] == ["python", "-m"]:
        return [sys.executable, *words[1:]]
    raise ConfigError(f"command {command!r}: want it to begin with crosspih or python -m")


def load_plan(path: Path = PLAN) -> list[PlannedSection]:
    """Read the list. Raises ConfigError naming the entry and the field."""
    try:
        content = yaml_of(text_of_file(path))
    except (OSError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    if not isinstance(content, list):
        raise ConfigError(f"{path}: wants a list of entries")
    entries: list[PlannedSection] = []
    for number, item in enumerate(content):
        try:
            entry = PlannedSection.model_validate(item)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            raise ConfigError(f"{path}: entry {number + 1}: {where}: {first['msg']}") from None
        for one in entry.expanded():
            if any(one.name == other.name for other in entries):
                raise ConfigError(f"{path}: entry {number + 1}: the name {one.name} is taken")
            arguments(one.command)
            entries.append(one)
    return entries
