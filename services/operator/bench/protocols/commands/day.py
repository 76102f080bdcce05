"""`crosspih bench day`."""

from __future__ import annotations

import json
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from crosspih_common.errors import ConfigError, CrosspihError
from services.operator.bench.cells.bar import Bar
from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.protocols.addresses import private_network
from services.operator.bench.protocols.commands.practise import HOLE_SEED
from services.operator.bench.protocols.day import BEFORE, PAGE, Walk, runs, table_of
from services.operator.bench.protocols.page import PageStep, steps_of
from services.operator.bench.protocols.plants import ADDRESSES, ProtocolWay, open_plant
from services.operator.bench.protocols.walked import check_walk, note_walk


def day(
    folder: Annotated[Path, typer.Argument(help="Where it is walked: the cell's files, recordings, logs.")],
    hidden: Annotated[int, typer.Option(min=0, help="Draws the differences between the cell and its file.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Draws where the hole is.")] = HOLE_SEED,
    first: Annotated[
        int, typer.Option(min=1, max=9, help="Section to begin with, in the folder of an earlier walk.")
    ] = 1,
    last: Annotated[int, typer.Option(min=1, max=9, help="Section to end with.")] = 9,
    page: Annotated[Path, typer.Option(help="What is walked.")] = PAGE,
    as_json: AsJson = False,
) -> None:
    """Walk docs/hardware/in-a-day.md by its own words, before a UR5e, an ATI sensor and two cameras that are other
    ends of their protocols: each command, what each calibration found of what the cell hides, and whether the peg went
    in. Status 1 where a command failed or a peg was not inserted."""
    console = Console(stderr=True)
    with errors_shown(console):
        try:
            steps = steps_of(page.read_text(encoding="utf-8"))
        except OSError as error:
            raise ConfigError(f"--page {page}: cannot be read ({error.strerror})") from None
        if first == 1 and folder.exists() and any(folder.iterdir()):
            raise ConfigError(f"{folder} is not empty; name another, or --first with a section above 1")
        folder.mkdir(parents=True, exist_ok=True)
        if first == 1:
            note_walk(folder, hidden, seed)
        else:
            check_walk(folder, console, hidden=hidden, seed=seed)
        private_network(ADDRESSES)
        with (
            tempfile.TemporaryDirectory(prefix="crosspih-day-") as logs,
            open_plant(ProtocolWay.UR, seed, Path(logs), hidden) as plant,
        ):
            walk = Walk(plant, folder.resolve(), console)
            try:
                with Bar(console) as bar:
                    _walk(walk, steps, first, last, bar)
            except CrosspihError as error:
                console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
            finally:
                walk.run(("down",))
            found = walk.found()
        if as_json:
            print(json.dumps({
                "hidden": hidden, "seed": seed, "steps": [asdict(one) for one in walk.done],
                "found": [one.as_json() for one in found],
                "assemblies": [one.model_dump(mode="json") for one in walk.assemblies],
            }))  # fmt: skip
        else:
            for table in table_of(walk, found):
                Console(width=110).print(table)
        if any(one.status for one in walk.done) or not all(one.inserted for one in walk.assemblies):
            raise typer.Exit(1)


def _walk(walk: Walk, steps: list[PageStep], first: int, last: int, bar: Bar) -> None:
    commands = [step for step in steps if first <= step.section <= last and runs(step)]
    task = bar.add_task("", total=len(commands))
    for step in steps:
        if step.section > last:
            break
        if step.section >= first:
            bar.update(task, description=f"section {step.section}", beside=escape(step.text))
            if step.section == 3 and not (walk.folder / BEFORE).exists():
                (walk.folder / BEFORE).write_text(walk.cell.read_text(encoding="utf-8"), encoding="utf-8")
            walk.take(step)
            bar.advance(task, runs(step))
        elif step.kind == "export":
            walk.take(step)
    if not (walk.folder / BEFORE).exists():
        (walk.folder / BEFORE).write_text(walk.cell.read_text(encoding="utf-8"), encoding="utf-8")
