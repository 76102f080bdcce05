"""`crosspih bench engines`."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.speed.engines import PROGRAM, EnginesResult, table_of
from services.operator.bench.speed.measured_by import measured_by


def engines(
    steps: Annotated[int, typer.Option(min=100, help="Steps a round; the best of four rounds counts.")] = 2000,
    as_json: AsJson = False,
) -> None:
    """Measure how fast each installed physics engine is."""
    console = Console(stderr=True)
    with errors_shown(console):
        result = EnginesResult(steps_s=measured_by(PROGRAM, "bench engines", "--steps", str(steps), console=console))
        if as_json:
            print(result.model_dump_json())
        else:
            Console().print(table_of(result))
