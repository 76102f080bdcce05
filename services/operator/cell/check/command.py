"""`crosspih cell check`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.client.checked import note_checked
from crosspih_common.errors import BusUnreachable
from crosspih_common.modules import run_folder
from services.operator.assembly.session import Session
from services.operator.assembly.stack import cell_session
from services.operator.bench.options import AsJson, errors_shown
from services.operator.cell.check.measuring import CheckManner, check_cell
from services.operator.cell.which_cell import using_cell
from services.operator.cli.rows import tell, wrong_ones


@contextmanager
def _some_session(speed: str | None) -> Iterator[Session]:
    """A session on the running cell, in whatever state it is; else on one that is started for this."""
    try:
        session = Session(connect_timeout_s=1.0)
    except BusUnreachable:
        with cell_session(speed, ("hardware",)) as (started, _):
            yield started
        return
    with session:
        yield session


def check(
    cell: Annotated[Path | None, typer.Option(help="The cell's file; that of CROSSPIH_CELL when left out.")] = None,
    speed: Annotated[str | None, typer.Option(help="realtime or max, of a cell that is started for it.")] = None,
    camera: Annotated[
        bool, typer.Option("--camera", help="Look at the cameras alone: nothing moves, no arm need be there.")
    ] = False,
    no_camera: Annotated[bool, typer.Option("--no-camera", help="The cell has none: it goes by force alone.")] = False,
    as_json: AsJson = False,
) -> None:
    """What is wrong with a cell, and how to mend it: moves little and gently. Status 1 when something is wrong."""
    console = Console(stderr=as_json)
    with errors_shown(console), using_cell(cell):
        with _some_session(speed) as session, console.status("looking at the cell") as status:
            manner = CheckManner(arm=not camera, camera_needed=not no_camera)
            rows = check_cell(session.bus, session.cell.workcell, manner, lambda text: status.update(text))
            name = session.bus.cell
            wrong = len(wrong_ones(rows))
            if manner.arm and not wrong and not session.simulated:
                note_checked(run_folder() / name, session.clock().boot_id)  # the first assembly then needs no check
        tell(rows, name, console, as_json, f"{wrong} of {len(rows)} wrong" if wrong else "nothing is wrong",
             f"cell {name}")  # fmt: skip
