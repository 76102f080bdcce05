"""`crosspih bench startup`."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.console import Console

from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.speed.startup import measured, table_of


def startup(
    rounds: Annotated[int, typer.Option(min=1, help="Rounds of all in turn; the result is their median.")] = 3,
    as_json: AsJson = False,
) -> None:
    """Measure how long a stack takes until all its services are ready beside the slowest single import, and the CPU
    time of small commands."""
    console = Console(stderr=True)
    with errors_shown(console):
        result = measured(rounds, console)
        if as_json:
            sys.stdout.write(result.model_dump_json(indent=1) + "\n")
        else:
            Console().print(table_of(result))
