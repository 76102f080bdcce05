"""`crosspih bench trials`."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.messages import Strategy
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import base_cell_text
from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.speed.where_time_goes import TrialTime, accounted_trial, result_of, table_of


def trials(
    trials: Annotated[int, typer.Option(min=1, help="Trials, one after the other, in one cell on one core.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1000,
    strategy: Annotated[Strategy, typer.Option(help="How to get the peg in.")] = Strategy.FUSED,
    as_json: AsJson = False,
) -> None:
    """Measure where the wall time of a trial goes: physics, rendering, thinking, waiting. `bench scaling` measures what
    more cells make of it. Linux."""
    console = Console(stderr=True)
    with errors_shown(console):
        content = cell_content(base_cell_text(), Condition())
        tasks = [
            CellTask(
                f"{strategy.value} {number}", content, accounted_trial, {"seed": number, "strategy": strategy.value}
            )
            for number in range(seed, seed + trials)
        ]
        accounts: dict[int, TrialTime] = {}
        pool = open_executor(ExecutorName.LOCAL, 1, len(tasks), None, True)
        progress = CellsProgress(console, "trials")
        progress.taken_over(len(tasks), 0)
        try:
            with progress:
                lost = run_in_cells(
                    tasks, pool, lambda at, found: accounts.update({at: TrialTime.model_validate(found)}), progress
                )
        finally:
            pool.close()
        for index, why in lost.items():
            console.print(f"{tasks[index].label}: {why}", style="red", markup=False, highlight=False)
        if not accounts:
            raise typer.Exit(1)
        result = result_of([accounts[index] for index in sorted(accounts)])
    if as_json:
        sys.stdout.write(result.model_dump_json(indent=1) + "\n")
    else:
        Console().print(table_of(result))
