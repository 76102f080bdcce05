"""`crosspih cell check`."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crosspih_common.errors import BusUnreachable
from services.operator.bench.options import AsJson, told
from services.operator.cell_check.measuring import Manner, check_cell
from services.operator.cell_check.verdict import Check, Verdict, fails
from services.operator.session import Session, using_cell
from services.operator.stack import cell_session

COLOURS = {Verdict.PASS: "green", Verdict.FAIL: "bold red", Verdict.SKIPPED: "yellow"}

cell_app = typer.Typer(no_args_is_help=True, help="The cell itself.")


def table_of(cell: str, checks: list[Check]) -> Table:
    """One row a check."""
    table = Table(title=f"cell {cell}", show_lines=bool(fails(checks)))
    for heading in ("check", "verdict", "found", "mend"):
        table.add_column(heading, overflow="fold")
    for check in checks:
        colour = COLOURS[check.verdict]
        table.add_row(
            check.name, f"[{colour}]{check.verdict.value}[/{colour}]", escape(check.found), escape(check.mend)
        )
    return table


@contextmanager
def _some_session(speed: str | None) -> Iterator[Session]:
    """On the running cell, in whatever state it is; else on one that is started for it."""
    try:
        session = Session(connect_timeout_s=1.0)
    except BusUnreachable:
        with cell_session(speed, ("hardware",)) as (started, _):
            yield started
        return
    with session:
        yield session


@cell_app.command()
def check(
    cell: Annotated[Path | None, typer.Option(help="The cell's file; that of CROSSPIH_CELL when left out.")] = None,
    speed: Annotated[str | None, typer.Option(help="realtime or max, of a cell that is started for it.")] = None,
    camera: Annotated[
        bool, typer.Option("--camera", help="Look at the cameras alone: nothing moves, no arm need be there.")
    ] = False,
    no_camera: Annotated[bool, typer.Option("--no-camera", help="The cell has none: it goes by force alone.")] = False,
    as_json: AsJson = False,
) -> None:
    """What is wrong with a cell, and how to mend it: moves little and gently. Status 1 when something fails."""
    console = Console(stderr=as_json)
    with told(console), using_cell(cell):
        with _some_session(speed) as session, console.status("looking at the cell") as status:
            manner = Manner(arm=not camera, camera_needed=not no_camera)
            checks = check_cell(session.bus, session.cell.workcell, manner, lambda text: status.update(text))
            name = session.bus.cell
        wrong = fails(checks)
        if as_json:
            said = {"cell": name, "ok": not wrong, "checks": [one.model_dump(mode="json") for one in checks]}
            sys.stdout.write(json.dumps(said) + "\n")
        else:
            console.print(table_of(name, checks))
            console.print(f"{len(wrong)} of {len(checks)} fail" if wrong else "nothing fails", highlight=False)
        if wrong:
            raise typer.Exit(1)
