"""`crosspih bench states`: the 26 contact states made on purpose in the cell, and how well each is recognised."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.config import load_cell
from crosspih_common.errors import ConfigError, CrosspihError
from services.operator.bench.cells.pool import ExecutorName
from services.operator.bench.contact_states.collecting import Collection, CollectionPlan
from services.operator.bench.contact_states.judged import judge
from services.operator.bench.contact_states.plan import RANDOM, arms_aimed_at
from services.operator.bench.contact_states.summary import summarise
from services.operator.bench.contact_states.tables import print_tables
from services.operator.cell.which_cell import cell_path
from services.operator.cli.failure import CommandFailure, Failed, failure_of
from services.operator.cli.options import AsJson

FOLDER = Path("results/contact-states")


def _stiffnesses(text: str) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"--stiffness {text}: want numbers with commas between, N/mm; 0 is the cell's own") from None
    if any(value < 0.0 for value in values) or len(set(values)) < len(values):
        raise ConfigError(f"--stiffness {text}: want different numbers of 0 or more")
    return values


def states(
    each: Annotated[int, typer.Option(min=1, help="Contacts of each state, over all stiffnesses.")] = 105,
    random: Annotated[int, typer.Option(min=0, help="Pushes at random for each stiffness.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Decides every push.")] = 1,
    stiffness: Annotated[str, typer.Option(help="Of the arm sideways at the rim, N/mm; 0: its own.")] = "20,0,200",
    folder: Annotated[Path, typer.Option(help="Keeps contacts, figures, pictures; a run goes on there.")] = FOLDER,
    cells: Annotated[int | None, typer.Option(min=1, help="Cells side by side; one a core without it.")] = None,
    executor: Annotated[ExecutorName, typer.Option(help="Where the cells are.")] = ExecutorName.LOCAL,
    ray_address: Annotated[str | None, typer.Option(help="Of a running Ray cluster.")] = None,
    confusion: Annotated[Path | None, typer.Option(help="Picture: true against named, else in the folder.")] = None,
    bands: Annotated[Path | None, typer.Option(help="Picture: n_z0 and the paper's bands, else in the folder.")] = None,
    reliability: Annotated[Path | None, typer.Option(help="Picture: confidence, else in the folder.")] = None,
    as_json: AsJson = False,
) -> None:
    """Push the peg so that each state comes about, judge the wrenches by rule and likelihood, and say who is right."""
    console = Console(stderr=True)
    try:
        wanted = CollectionPlan(each, random, seed, _stiffnesses(stiffness))
        cell = load_cell(cell_path())
        collection = Collection(cell, wanted, folder, console)
        lost = collection.collect(cells, executor, ray_address)
        judged = judge(collection, folder, cells, console)
    except KeyboardInterrupt:
        said = f"stopped; what was pushed stands in {folder}"
        console.print(said, highlight=False)
        raise Failed(CommandFailure("stopped", said), 130) from None
    except CrosspihError as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise Failed(failure_of(error)) from None
    for line in lost:
        console.print(line, style="yellow", markup=False, highlight=False, soft_wrap=True)
    figures = summarise(judged)
    figures["by_geometry"] = {f"{one:g}": arms_aimed_at(collection.plan(one)) for one in sorted(wanted.stiffness_n_mm)}
    purposed = [one for one in judged if one.contact.result.target != RANDOM]
    # matplotlib takes time to load: other commands should not wait for it
    from services.operator.bench.contact_states.figures import draw_bands, draw_confusion, draw_reliability

    draw_confusion(judged, confusion or folder / "confusion.png")
    draw_bands(judged, cell.workcell.friction_expected, bands or folder / "n_z0.png")
    draw_reliability(purposed, reliability or folder / "reliability.png")
    (folder / "states.json").write_text(json.dumps(figures, indent=1), encoding="utf-8")
    if as_json:
        json.dump(figures, sys.stdout, indent=1)
        print()
    else:
        print_tables(figures, Console())
        console.print(f"pictures and figures in {folder}", highlight=False)
