"""`crosspih bench soak`: one stack, one assembly after the other, each recorded, and what grows meanwhile."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Annotated

import typer
from pydantic import BaseModel, ConfigDict
from rich.console import Console
from rich.table import Table

from services.operator.assembly.session import NEEDED, Session
from services.operator.bench.cells.bar import Bar
from services.operator.bench.cells.conditions import Condition, cell_content, merged
from services.operator.bench.cells.own_cell import SPEEDS, CellTask, OwnCell
from services.operator.bench.cells.trials import base_cell_text
from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.reliability.soak.measuring import Figures, Grown, assembled, complaints, grown, statuses_of

RUN = "CROSSPIH_RUN_DIR"  # where OwnCell keeps the stack's state and logs


class SoakResult(BaseModel):
    """What `crosspih bench soak --json` prints."""

    model_config = ConfigDict(frozen=True)

    speed: str
    minutes: float
    assemblies: int
    inserted: int
    recorded_mb: float
    grown: list[Grown]
    complaints: list[str]
    each: list[Figures]


def table_of(result: SoakResult) -> Table:
    """One line per figure."""
    table = Table(
        title=f"{result.assemblies} assemblies in {result.minutes:.0f} minutes at {result.speed}, {result.inserted} "
        f"inserted, {result.recorded_mb:.0f} MB recorded"
    )
    seen = Counter(one.vision for one in result.each)
    table.caption = "vision: " + ", ".join(f"{count} {words}" for words, count in seen.most_common())
    for name in ("", "first", "last", "grown by", "95 %", ""):
        table.add_column(name, justify="left" if name == "" else "right")
    for row in result.grown:
        unit = f" {row.unit}" if row.unit else ""
        table.add_row(
            row.what, f"{row.first:.1f}{unit}", f"{row.last:.1f}{unit}", f"{row.grown:+.2f}",
            f"{row.low:+.2f} to {row.high:+.2f}", "flat" if row.flat else "[red]grows[/]",
        )  # fmt: skip
    return table


def soak(
    minutes: Annotated[float, typer.Option(min=0.1, help="How long; an assembly that has begun is ended.")] = 60.0,
    speed: Annotated[str, typer.Option(help=" or ".join(SPEEDS))] = "max",
    seed: Annotated[int, typer.Option(min=0, help="Of the first assembly; each has the next one.")] = 1000,
    keep: Annotated[
        Path | None, typer.Option(help="A folder in which the recordings stay; without it each is removed.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Assemble for an hour in one stack, and see whether memory, descriptors, threads, latency and disk stay where they
    are, and nothing is dropped. Status 1 where something grows, was lost, or was not inserted. Linux."""
    console = Console(stderr=True)
    with errors_shown(console):
        taken: list[Figures] = []
        began_s = time.monotonic()
        with tempfile.TemporaryDirectory(prefix="crosspih-soak-") as folder:
            recordings = {"recorder": {"directory": folder if keep is None else str(keep.resolve())}}
            content = merged(cell_content(base_cell_text(), Condition()), recordings)
            services = (*NEEDED, "recorder")
            cell = OwnCell(0, CellTask("soak", content, lambda session, payload: None, None, services, speed=speed))
            try:
                session = cell.start()
                began_s = time.monotonic()
                _soak(session, taken, console, began_s, minutes, seed, keep is not None)
            except KeyboardInterrupt:
                console.print("ended early: what was seen until then", highlight=False)
            finally:
                cell.close()
        rows = grown(taken)
        result = SoakResult(
            speed=speed, minutes=(time.monotonic() - began_s) / 60.0, assemblies=len(taken),
            inserted=sum(one.inserted for one in taken), recorded_mb=sum(one.recorded_mb for one in taken),
            grown=rows, complaints=complaints(taken, rows), each=taken,
        )  # fmt: skip
        if as_json:
            sys.stdout.write(result.model_dump_json(indent=1) + "\n")
        else:
            Console(width=110).print(table_of(result))
        for said in result.complaints:
            console.print(said, style="red", markup=False, highlight=False, soft_wrap=True)
        if result.complaints or not taken:
            raise typer.Exit(1)


def _soak(
    session: Session, taken: list[Figures], console: Console, began_s: float, minutes: float, seed: int, keep: bool
) -> None:
    statuses, run = statuses_of(session), Path(os.environ[RUN])
    with Bar(console, counted=False) as progress:
        bar = progress.add_task("soak", total=minutes * 60.0)
        while (now_s := time.monotonic() - began_s) < minutes * 60.0:
            progress.update(bar, completed=now_s, description=f"soak, {len(taken)} assemblies")
            taken.append(assembled(session, statuses, seed + len(taken), run, keep, began_s))
