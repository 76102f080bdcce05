"""The settings of a walk in a folder of `crosspih bench day`: its calibrations are valid for that cell only."""

from __future__ import annotations

import json
from pathlib import Path

from rich.console import Console

from crosspih_common.errors import ConfigError
from crosspih_common.provenance import code_version

ABOUT = "day.json"
# the code that walks and calibrates, besides the cell's own code
MADE_BY = ("services.operator.calibrate", "services.operator.bench.protocols")


def note_walk(folder: Path, hidden: int, seed: int) -> None:
    """Write the settings at the beginning of a walk."""
    about = {"hidden": hidden, "seed": seed, "code": code_version(*MADE_BY)}
    (folder / ABOUT).write_text(json.dumps(about), encoding="utf-8")


def check_walk(folder: Path, console: Console, **asked: int) -> None:
    """Check that a folder was walked with these numbers (`hidden`, `seed`), and by which code. Raises ConfigError where
    they differ; prints a note where none are recorded.
    """
    if not (folder / ABOUT).is_file():
        console.print(f"{folder}: does not record the settings of its walk", style="yellow", highlight=False)
        return
    there = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
    for name, number in asked.items():
        if there.get(name) != number:
            raise ConfigError(f"{folder} was walked with --{name} {there.get(name)}, not {number}")
    if there.get("code") != (code := code_version(*MADE_BY)):
        console.print(f"{folder}: walked by code {there.get('code')}, gone on with by {code}", style="yellow")
