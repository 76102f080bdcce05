"""`crosspih recording export layouts`: the panels of deploy/layouts with the keys of a recording's own cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

import deploy
from crosspih_common.config.name import DEFAULT_NAME
from crosspih_common.errors import ConfigError
from crosspih_common.keys import CLOCK, ROOT
from crosspih_common.recording import read_recording
from services.operator.bench.options import errors_shown

LAYOUTS = Path(deploy.__file__).resolve().parent / "layouts"


def layouts(
    recording: Annotated[Path, typer.Argument(help="A recording (.mcap).")],
    folder: Annotated[Path, typer.Argument(help="Where the layouts go; it is made.")],
) -> None:
    """Write the layouts for Foxglove and Lichtblick with the name of a recording's cell, where it is not cell1."""
    console = Console()
    with errors_shown(console):
        name = read_recording(recording, [CLOCK]).cell
        if not name:
            raise ConfigError(f"{recording}: tells no cell's name, neither in its metadata nor in its keys")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for file in sorted(LAYOUTS.glob("*.json")):
                (folder / file.name).write_text(for_cell(file.read_text(encoding="utf-8"), name), encoding="utf-8")
                console.print(f"{folder / file.name}: cell {name}", highlight=False, markup=False, soft_wrap=True)
        except OSError as error:
            raise ConfigError(f"{folder}: cannot be written ({error.strerror})") from None


def for_cell(layout: str, name: str) -> str:
    """A layout of deploy/layouts with the keys of the cell of that name."""
    return layout.replace(f"{ROOT}/{DEFAULT_NAME}/", f"{ROOT}/{name}/")
