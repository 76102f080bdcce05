"""`crosspih bench assembly`: many seeds in cells side by side, or one after the other on the running stack."""

from __future__ import annotations

import json
import sys
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from crosspih_common.config import load_cell
from crosspih_common.config.drawing import OUTLINES
from crosspih_common.errors import ConfigError
from crosspih_common.messages import Strategy, WithdrawResult
from services.operator.assembly.show import directions_held
from services.operator.bench.assembly.running import on_the_running_stack, repeatability_table, repeated
from services.operator.bench.assembly.swap import Done, NextPegWay, Trials, swapped
from services.operator.bench.cells.conditions import DEFAULT_PEG, condition_of
from services.operator.bench.cells.pool import ExecutorName
from services.operator.bench.cells.trials import DEFAULT_STORE, TrialJob
from services.operator.bench.options import AsJson, Cells, RayAddress, Store, Where, errors_shown, trials_of
from services.operator.bench.pictures.running import folder_of
from services.operator.bench.pictures.trials import with_pictures
from services.operator.cell.settings import require_settings
from services.operator.cell.which_cell import cell_path
from services.operator.scoring.statistics import BenchResult, sight_of, sight_row, summarise


def figures_table(result: BenchResult, condition: str = "", seeds: str = "") -> Table:
    """The distribution of each figure, the failures, and the directions that the bore's walls do not fix."""
    table = Table(
        title=f"{result.strategy}{condition and ', '}{condition}: {result.inserted} of {result.trials} inserted "
        f"(95 % Wilson {result.wilson95_low:.1%} to {result.wilson95_high:.1%}), "
        + (
            "no simulator, the same hole each time"
            if result.each[0].seed is None
            else seeds or f"seeds from {result.seed}"
        )
    )
    table.add_column("figure")
    for name in ("p50", "p95", "max", "n"):
        table.add_column(name, justify="right")
    for name, value in result.figures.items():
        table.add_row(name, f"{value.p50:.3f}", f"{value.p95:.3f}", f"{value.max:.3f}", str(value.count))
    sight = result.sight
    table.add_section()
    table.add_row("vision looked", "", "", "", str(sight.looked))
    for code, count in sight.refused.items() or [("", 0)]:
        table.add_row(f"vision refused{code and ': '}{code}", "", "", "", str(count))
    table.add_row("found by force instead", "", "", "", str(sight.felt_for))
    table.add_row("of these inserted", "", "", "", str(sight.felt_for_inserted))
    table.add_row("inserted without a touch", "", "", "", str(sight.untouched))
    for name, count in result.failures.items():
        table.add_row(f"[red]failed: {name}[/red]", "", "", "", str(count))
    ranks = sorted({one.rank for one in result.each if one.rank is not None})
    if ranks and ranks[0] < 5:
        table.caption = f"directions the walls hold: {directions_held(ranks[0])}"
    return table


def assembly(
    trials: Annotated[int, typer.Option(min=1, help="How many seeds.")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1000,
    strategy: Annotated[Strategy, typer.Option(help="How to get the peg in.")] = Strategy.FUSED,
    peg: Annotated[str, typer.Option(help=f"{', '.join(OUTLINES)}, or an SVG or DXF file.")] = DEFAULT_PEG,
    way: Annotated[
        NextPegWay,
        typer.Option(help="direct, or swap: the cross first, then the peg at the pose known from it, untouched."),
    ] = NextPegWay.DIRECT,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Another setting of the cell's file: hardware.simulated.friction_coefficient=0.2"),
    ] = None,
    pictures: Annotated[
        str | None,
        typer.Option(
            help="The cameras show another renderer's pairs: `rendered` or a folder; its scenes are the seeds."
        ),
    ] = None,
    rows: Annotated[str | None, typer.Option(help="With --pictures: these rows, with commas.")] = None,
    record: Annotated[bool, typer.Option(help="Record every trial; trials in the store are made again.")] = False,
    cells: Cells = None,
    executor: Where = ExecutorName.LOCAL,
    ray_address: RayAddress = None,
    store: Store = DEFAULT_STORE,
    running: Annotated[
        bool, typer.Option("--running", help="On the running stack (a real cell, too), one after the other, unstored.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Assemble with each of N seeds, in cells side by side, and print the distribution of what came out."""
    console = Console(stderr=True)
    with errors_shown(console):
        require_settings(settings or ())
        condition = condition_of(settings or ())
        withdrawals: list[WithdrawResult] | None = None
        crosses: Done = []
        jobs = [TrialJob(seed=seed + index, strategy=strategy, condition=condition, peg=peg) for index in range(trials)]
        if pictures is not None:
            if running or peg != DEFAULT_PEG:
                raise ConfigError(
                    "--pictures: the pairs show the cross, in cells of their own; leave --running and --peg out"
                )
            named = None if rows is None else [name.strip() for name in rows.split(",") if name.strip()]
            jobs = with_pictures(jobs, folder_of(pictures, console), named)
        if running:
            if peg != DEFAULT_PEG or way is not NextPegWay.DIRECT:
                raise ConfigError("--running: the running stack has its own peg; leave --peg and --way out")
            done, ended, withdrawals = on_the_running_stack(console, jobs, record)
        else:

            def run(title: str, some: list[TrialJob]) -> Trials:
                return trials_of(
                    console, title, some, cells=cells, executor=executor, ray_address=ray_address, store=store,
                    record=record,
                )  # fmt: skip

            if way is NextPegWay.SWAP:
                done, crosses, ended = swapped(jobs, run)
            else:
                done, ended = run(strategy.value, jobs)
        if done:
            name = strategy.value if peg == DEFAULT_PEG else f"{peg}, {strategy.value}, {way.value}"
            result = summarise(name, jobs[0].seed, [figures for _, figures in done])
            spread = None
            if withdrawals is not None:
                drawing = load_cell(cell_path()).workcell.peg
                spread = repeated(done, drawing.shape().outline.symmetry_order)
            if as_json:
                told_too = {} if spread is None else {"repeatability": spread.model_dump()}
                if crosses:
                    told_too["sight_of_crosses"] = sight_of([figures for _, figures in crosses]).model_dump()
                json.dump({**result.model_dump(), **told_too}, sys.stdout, indent=1)
                print()
            else:
                told_beside = [*(settings or ()), *([] if pictures is None else [f"pictures of {pictures}"])]
                Console().print(
                    figures_table(result, " ".join(told_beside), "" if pictures is None else "the scenes' seeds")
                )
                if crosses:
                    said, counts = sight_row([figures for _, figures in crosses])
                    Console().print(f"the crosses before them: {said}: {counts}", highlight=False)
                if spread is not None:
                    Console().print(repeatability_table(spread, withdrawals or []))
        if ended is not None:
            raise ended
