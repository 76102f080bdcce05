"""`crosspih foxglove`: the running cell as a WebSocket for Foxglove and Lichtblick."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.errors import ConfigError
from crosspih_common.modules import module_command
from services.operator.bench.options import errors_shown

HOST, PORT = "CROSSPIH_FOXGLOVE_HOST", "CROSSPIH_FOXGLOVE_PORT"


def foxglove(
    host: Annotated[
        str | None, typer.Option(help="Where to listen; 127.0.0.1 when left out. It asks nobody who comes.")
    ] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="8765 when left out; 0: any free one.")] = None,
) -> None:
    """Show the running cell in Foxglove or Lichtblick, live, until Ctrl-C: a WebSocket to connect to."""
    with errors_shown(Console(stderr=True)):
        if importlib.util.find_spec("foxglove") is None:
            raise ConfigError("crosspih foxglove needs foxglove-sdk: pip install 'crosspih[foxglove]'")
        said = {name: str(value) for name, value in ((HOST, host), (PORT, port)) if value is not None}
        process = subprocess.Popen(module_command("services.foxglove"), env={**os.environ, **said})
        while True:
            try:
                status = process.wait()
                break
            except KeyboardInterrupt:
                continue  # the terminal sends Ctrl-C to both processes; the service ends by itself
        sys.exit(status)
