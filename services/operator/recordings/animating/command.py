"""`crosspih recording animate FILE`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.errors import CrosspihError


def animate(
    file: Annotated[Path, typer.Argument(help="A recording (.mcap); its further parts are found beside it.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="A .webp, .gif or .mp4; beside the recording when left out.")
    ] = None,
    seconds: Annotated[float, typer.Option(min=2.0, max=120.0, help="How long the moving picture is.")] = 14.0,
    fps: Annotated[float, typer.Option(min=2.0, max=30.0, help="Frames a second.")] = 10.0,
    truth: Annotated[
        bool, typer.Option("--truth", help="The plate where it really is, said so, instead of where it was found.")
    ] = False,
) -> None:
    """Make a moving picture of a recorded assembly: the arm, peg and hole from near, and the forces running along.

    Ways through air pass quickly.
    """
    console = Console(stderr=True)
    made = out or file.with_suffix(".webp")
    try:
        # matplotlib and OpenCV take time to load: no other command of a recording should wait for them
        from services.operator.recordings.animating.film import animate as make

        with console.status("drawing"):
            count = make(file, made, seconds, fps, truth)
    except CrosspihError as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from None
    typer.echo(f"{made}: {count} frames, {made.stat().st_size / 1e6:.2f} MB")
