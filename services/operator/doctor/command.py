"""`crosspih doctor`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crosspih_common.messages import Strategy
from services.operator.bench.options import AsJson, told
from services.operator.doctor.examination import Wish, examine
from services.operator.doctor.row import Row, Verdict
from services.operator.for_cell import CELL_HELP
from services.operator.session import cell_path, endpoint

COLOURS = {Verdict.OK: "green", Verdict.WARNING: "yellow", Verdict.WRONG: "bold red"}


def table_of(rows: list[Row]) -> Table:
    """One line each."""
    table = Table()
    for heading in ("what", "is", "found", "mend"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        colour = COLOURS[row.verdict]
        table.add_row(
            escape(row.name), f"[{colour}]{row.verdict.value}[/{colour}]", escape(row.found), escape(row.mend)
        )
    return table


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
    with told(console):
        wish = Wish(Path(cell or cell_path()), endpoint(), strategy, devices, temperature)
        with console.status("looking") as status:
            rows = examine(wish, say=lambda text: status.update(f"looking at: {text}"))
        wrong = [row for row in rows if row.verdict is Verdict.WRONG]
        warned = [row for row in rows if row.verdict is Verdict.WARNING]
        if as_json:
            said = {"ok": not wrong, "cell": str(wish.cell), "rows": [row.model_dump(mode="json") for row in rows]}
            sys.stdout.write(json.dumps(said) + "\n")
        else:
            console.print(table_of(rows))
            could = "an assembly could start" if not wrong else "no assembly could start"
            console.print(f"{len(wrong)} wrong, {len(warned)} warnings: {could}", highlight=False)
        if wrong:
            raise typer.Exit(1)
