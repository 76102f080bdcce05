"""`crosspih bench cell`."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.speed.cell import PROGRAM, CellResult, table_of
from services.operator.bench.speed.measured_by import measured_by


def cell(
    steps: Annotated[int, typer.Option(min=100, max=60000, help="Steps a round; the best of five counts.")] = 2000,
    as_json: AsJson = False,
) -> None:
    """Measure how fast the simulated cell is, and each physics engine by itself in the same run."""
    console = Console(stderr=True)
    with errors_shown(console):
        result = CellResult(steps_s=measured_by(PROGRAM, "bench cell", "--steps", str(steps), console=console))
        if as_json:
            print(result.model_dump_json())
        else:
            Console().print(table_of(result))
