"""`crosspih bench busy`."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.errors import ConfigError, CrosspihError
from crosspih_common.messages import Strategy
from services.operator.assembly.session import NEEDED
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.local_executor import usable_cores
from services.operator.bench.cells.own_cell import SPEEDS, CellTask
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import base_cell_text
from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.reliability.busy.loading import BusyResult, Ended, assemble_once, busy_processes, table_of


def busy(
    assemblies: Annotated[int, typer.Option(min=1, help="One after the other, each with the next seed.")] = 20,
    processes: Annotated[int, typer.Option(min=0, max=256, help="That compute all the time beside them.")] = 8,
    speed: Annotated[str, typer.Option(help=" or ".join(SPEEDS))] = "realtime",
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1000,
    strategy: Annotated[Strategy, typer.Option(help="How to get the peg in.")] = Strategy.FUSED,
    as_json: AsJson = False,
) -> None:
    """Assemble while other processes keep the machine busy. Ends with status 0 only if no assembly was stopped by the
    arm's lease or because a living service was taken for lost.
    """
    console = Console(stderr=True)
    with errors_shown(console):
        if speed not in SPEEDS:
            raise ConfigError(f"--speed {speed}: want {' or '.join(SPEEDS)}")
        content = cell_content(base_cell_text(), Condition())
        seeds = range(seed, seed + assemblies)
        tasks = [
            CellTask(
                f"busy {one}", content, assemble_once, {"seed": one, "strategy": strategy.value}, NEEDED, speed=speed
            )
            for one in seeds
        ]
        found: dict[int, Ended] = {}
        progress = CellsProgress(console, f"{processes} busy processes")
        progress.taken_over(len(tasks), 0)

        def on_result(index: int, result: Any) -> None:
            one = found[index] = Ended.model_validate(result)
            if not one.inserted:
                progress.say(f"seed {one.seed}: {one.failure} {one.detail}", "red")

        pool = open_executor(ExecutorName.LOCAL, 1, len(tasks))
        try:
            with busy_processes(processes), progress:
                lost = run_in_cells(tasks, pool, on_result, progress)
        finally:
            pool.close()
        for index, why in lost.items():
            console.print(f"{tasks[index].label}: lost its cell: {why}", style="red", markup=False, highlight=False)
        if not found:
            raise CrosspihError("bench busy: no assembly could be made")
        rows = [found[index] for index in sorted(found)]
        result = BusyResult(
            speed=speed,
            busy_processes=processes,
            cores=usable_cores(),
            inserted=sum(one.inserted for one in rows),
            stopped=sum(one.stopped for one in rows),
            assemblies=rows,
        )
        if as_json:
            sys.stdout.write(result.model_dump_json(indent=1) + "\n")
        else:
            Console(width=100).print(table_of(result))
        if result.stopped or lost:
            raise typer.Exit(1)
