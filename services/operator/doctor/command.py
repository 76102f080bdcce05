"""`crosspih doctor`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.messages import Strategy
from services.operator.bench.options import AsJson, errors_shown
from services.operator.cell.which_cell import cell_path, endpoint
from services.operator.cli.for_cell import CELL_HELP
from services.operator.cli.rows import Verdict, tell, wrong_ones
from services.operator.doctor.examination import Wish, examine


def doctor(
    cell: Annotated[Path | None, typer.Option(help=CELL_HELP)] = None,
    strategy: Annotated[Strategy, typer.Option(help="What is to be possible.")] = Strategy.FUSED,
    devices: Annotated[
        bool, typer.Option(help="Open the devices where no hardware service runs; nothing is moved.")
    ] = True,
    temperature: Annotated[
        float | None, typer.Option(help="At the cell now, °C: compared with that of the calibrations.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Could an assembly start? Looks at machine, cell file, devices and calibrations; moves nothing. Status 1: no."""
    console = Console(stderr=as_json)
    with errors_shown(console):
        wish = Wish(Path(cell or cell_path()), endpoint(), strategy, devices, temperature)
        with console.status("looking") as status:
            rows = examine(wish, say=lambda text: status.update(f"looking at: {text}"))
        wrong, warned = len(wrong_ones(rows)), sum(row.verdict is Verdict.WARNING for row in rows)
        could = "no assembly could start" if wrong else "an assembly could start"
        tell(rows, str(wish.cell), console, as_json, f"{wrong} wrong, {warned} warnings: {could}")
