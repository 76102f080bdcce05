"""`crosspih report FILE`, and `crosspih report FILE FILE`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from crosspih_common.recording import RecordingError
from services.operator.report import make_comparison, make_report


def report(
    files: Annotated[
        list[Path],
        typer.Argument(help="A recording (.mcap), also one that was torn off; or two, which are compared."),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The page; beside the first recording when left out.")
    ] = None,
) -> None:
    """Make one self-contained HTML page about a recorded assembly, or about two side by side."""
    if len(files) > 2:
        raise typer.BadParameter(f"{len(files)} recordings; want one, or two to compare", param_hint="files")
    first = files[0]
    if folders := [str(one) for one in files if one.is_dir()]:
        raise typer.BadParameter(f"{folders[0]} is a folder; name a recording (.mcap) in it", param_hint="files")
    name = first.with_suffix(".html") if len(files) == 1 else first.with_name(f"{first.stem}-and-{files[1].stem}.html")
    page = output or name
    try:
        if len(files) == 1:
            make_report(first, page)
        else:
            make_comparison(first, files[1], page)
    except (RecordingError, OSError) as error:
        typer.echo(f"report: {error}", err=True)
        raise typer.Exit(1) from None
    typer.echo(str(page))
