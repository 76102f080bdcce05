"""`crosspih report FILE`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from crosspih_common.recording import RecordingError
from services.operator.report import make_report


def report(
    file: Annotated[Path, typer.Argument(help="A recording (.mcap), also one that was torn off.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The page; beside the recording when left out.")
    ] = None,
) -> None:
    """Make one self-contained HTML page about a recorded assembly."""
    page = output or file.with_suffix(".html")
    try:
        make_report(file, page)
    except (RecordingError, OSError) as error:
        typer.echo(f"report: {error}", err=True)
        raise typer.Exit(1) from None
    typer.echo(str(page))
