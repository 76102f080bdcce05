"""The options that the guided calibrations share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.client.running_recording import RunningRecording
from services.operator.assembly.session import Session
from services.operator.cli.for_cell import CELL_HELP

BOARD_HELP = "squares across x down:square:marker:dictionary, metres: 9x6:0.02:0.015:DICT_4X4_50. Left out: the cell's."
CellOption = Annotated[Path | None, typer.Option(help=CELL_HELP)]
ShareOption = Annotated[float, typer.Option(min=0.02, max=1.0, help="Of the arm's own speed limits, in free air.")]
SpeedOption = Annotated[str | None, typer.Option(help="realtime or max, of a cell that is started for it.")]
RecordOption = Annotated[bool, typer.Option("--record", help="Record it as well; --from takes the recording.")]
OutOption = Annotated[Path | None, typer.Option(help="Where the cell's file goes with what was found.")]


def needed(services: tuple[str, ...], record: bool) -> tuple[str, ...]:
    """The needed services; with the recorder, where a recording is wanted."""
    return (*services, "recorder") if record else services


@contextmanager
def recorded(session: Session, what: str, record: bool, console: Console) -> Iterator[None]:
    """Record during the block and print the recording's name at its end, however it ends. Raises as `Bus.call`."""
    if not record:
        yield
        return
    tape = RunningRecording(session.bus, f"calibrate-{what}", required=True)
    try:
        yield
    finally:
        kept = tape.end()
        console.print(f"recording: {' '.join(kept.parts)}", highlight=False, soft_wrap=True)
        say_notes(console, [f"  {said}" for said in kept.warnings])


def say_notes(console: Console, notes: Sequence[str]) -> None:
    """Print notes about a recording."""
    for note in notes:
        console.print(note, style="yellow", highlight=False, markup=False, soft_wrap=True)
