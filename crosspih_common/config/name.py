"""The name of a cell, for commands that only list who is on its bus."""

from __future__ import annotations

import re
from pathlib import Path

import yaml

from crosspih_common.errors import ConfigError
from crosspih_common.plain_yaml import MAX_BYTES, text_of_file, yaml_of

DEFAULT_NAME = "cell1"
NAME = r"^[a-z0-9][a-z0-9_-]{0,31}$"


def cell_name(path: str | Path) -> str:
    """`cell.name` of a cell's file; nothing else in it is checked. Raises ConfigError."""
    try:
        content = yaml_of(text_of_file(Path(path), MAX_BYTES)) or {}
    except (OSError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    section = content.get("cell") if isinstance(content, dict) else None
    name = section.get("name", DEFAULT_NAME) if isinstance(section, dict) else DEFAULT_NAME
    if not isinstance(name, str) or not re.match(NAME, name):
        raise ConfigError(f"{path}: cell.name: {name!r} is no cell's name; want one that matches {NAME}")
    return name
