"""`crosspih recording export csv` and `crosspih recording export parquet`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.errors import ConfigError
from crosspih_common.recording import read_recording
from services.operator.bench.options import errors_shown
from services.operator.recordings.export.tables import Columns, chosen, columns_of, write_csv, write_parquet

File = Annotated[Path, typer.Argument(help="A recording (.mcap), also a torn or damaged one; with all its parts.")]
Folder = Annotated[Path, typer.Argument(help="The folder that is made; a file a key goes into it.")]
Keys = Annotated[
    list[str] | None, typer.Option("--key", help="Only this key, such as arm/joint_state; may be given again.")
]


def csv(recording: File, out: Folder, key: Keys = None) -> None:
    """Write a recording as CSV files, one a key: for spreadsheets. Pictures without their bytes."""
    _export(recording, out, key or [], "csv", write_csv)


def parquet(recording: File, out: Folder, key: Keys = None) -> None:
    """Write a recording as Parquet files, one a key: for pandas, Polars, DuckDB."""
    _export(recording, out, key or [], "parquet", write_parquet)


def _export(file: Path, out: Path, keys: list[str], suffix: str, write: Callable[[Columns, Path], int]) -> None:
    console = Console()
    with errors_shown(console):
        if out.exists():
            raise ConfigError(f"{out}: is there already; name a folder that is not")
        recording = read_recording(file)
        names = chosen(recording, keys)
        if not names:
            raise ConfigError(f"{file}: holds no message")
        try:
            out.mkdir(parents=True)
            for key, name in names.items():
                rows = write(columns_of(recording, key), out / f"{name}.{suffix}")
                console.print(f"{rows:8d}  {name}.{suffix}", highlight=False)
        except OSError as error:
            raise ConfigError(f"{out}: cannot be written ({error.strerror})") from None
        if not recording.finished:
            console.print(
                f"{file}: is damaged ({recording.tear}); its undamaged messages are in the tables", highlight=False
            )
        for line in recording.problems[:5]:
            console.print(f"left out: {line}", highlight=False, markup=False)
