"""`crosspih view`: the page of a recording, served by the viewer in a separate process; no stack is needed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from crosspih_common.modules import module_command


def view(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="One recording, or two.", show_default=False)],
    cell: Annotated[
        Path | None, typer.Option(help="The cell's file, where another than the recording's own is to be shown.")
    ] = None,
    host: Annotated[
        str,
        typer.Option(envvar="CROSSPIH_VIEWER_HOST", help="Where to listen; elsewhere it asks for a token."),
    ] = "127.0.0.1",
    port: Annotated[
        int | None, typer.Option(envvar="CROSSPIH_VIEWER_PORT", help="8080, or the next free one, where not given.")
    ] = None,
) -> None:
    """A recording in the browser, with a time slider: the cell in 3-D, forces, touches, pictures; or two side by
    side."""
    words = ["--host", host or "127.0.0.1", *(["--port", str(port)] if port is not None else [])]
    words += ["--recording", *map(str, files), *(["--cell", str(cell)] if cell is not None else [])]
    page = subprocess.Popen(module_command("services.viewer", *words), env=dict(os.environ))
    status = _ended(page)
    if status:
        raise typer.Exit(1)


def _ended(page: subprocess.Popen[bytes]) -> int:
    """The viewer's exit status. It ends by itself, or by the Ctrl-C that reaches both processes."""
    previous = signal.signal(signal.SIGTERM, lambda number, frame: page.terminate())
    try:
        while True:
            try:
                return page.wait()
            except KeyboardInterrupt:
                if sys.stdin is None or not sys.stdin.isatty():
                    page.send_signal(signal.SIGINT)  # where no terminal has sent the signal to both
    finally:
        signal.signal(signal.SIGTERM, previous)
