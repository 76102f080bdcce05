"""`crosspih bench scaling`."""

from __future__ import annotations

import sys
import time
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from crosspih_common.messages import Strategy
from services.operator.bench.cells.local_executor import usable_cores
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.pool import ExecutorName
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import TrialJob, run_trials
from services.operator.bench.cells.worker import Outcome
from services.operator.bench.options import AsJson, RayAddress, Where, errors_shown
from services.operator.bench.speed.scaling import Rate, ScalingResult


class _Timed(CellsProgress):
    """Notes when each cell's trials end."""

    def __init__(self, console: Console, title: str) -> None:
        super().__init__(console, title)
        self.ends_s: dict[int, list[float]] = {}
        self.slowest_start_s = 0.0

    def ended(self, cell: int, task: CellTask, outcome: Outcome, again: bool) -> None:
        """See Watcher."""
        super().ended(cell, task, outcome, again)
        self.ends_s.setdefault(cell, []).append(time.monotonic())
        self.slowest_start_s = max(self.slowest_start_s, outcome.start_s)

    def steady(self) -> tuple[int, float]:
        """The number of trials, and the seconds, from the moment when the last cell has done its first trial to the
        moment when the first cell runs out of work: in between all cells are busy.
        """
        begin = max(ends[0] for ends in self.ends_s.values())
        end = min(ends[-1] for ends in self.ends_s.values())
        trials = sum(begin < moment <= end for ends in self.ends_s.values() for moment in ends)
        return trials, end - begin


def scaling(
    trials: Annotated[int, typer.Option(min=4, help="Trials for each cell.")] = 12,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1000,
    strategy: Annotated[Strategy, typer.Option(help="How to get the peg in.")] = Strategy.FUSED,
    cells: Annotated[int | None, typer.Option(min=1, help="The most cells; one a core when left out.")] = None,
    executor: Where = ExecutorName.LOCAL,
    ray_address: RayAddress = None,
    as_json: AsJson = False,
) -> None:
    """Measure how many trials a second one cell makes, two cells, and so on, each cell on a core of its own."""
    console = Console(stderr=True)
    with errors_shown(console):
        rates: list[Rate] = []
        for count in range(1, (cells or usable_cores()) + 1):
            watcher = _Timed(console, f"{count} cells")
            # no store: a result taken from it would take no time
            jobs = [TrialJob(seed=seed + index, strategy=strategy) for index in range(trials * count)]
            run_trials(
                jobs, cells=count, executor=executor, ray_address=ray_address, progress=watcher, one_core_each=True
            )  # fmt: skip
            made, elapsed_s = watcher.steady()
            rate = made / elapsed_s
            rates.append(
                Rate(
                    cells=count,
                    trials=made,
                    elapsed_s=elapsed_s,
                    trials_s=rate,
                    linear=rate / (count * (rates[0].trials_s if rates else rate)),
                    slowest_start_s=watcher.slowest_start_s,
                )
            )
        result = ScalingResult(
            executor=executor.value, cores=usable_cores(), each_on_one_core=executor is ExecutorName.LOCAL, rates=rates
        )
        if as_json:
            sys.stdout.write(result.model_dump_json(indent=1) + "\n")
        else:
            Console().print(_table(result))


def _table(result: ScalingResult) -> Table:
    pinned = ", each cell on one core" if result.each_on_one_core else ""
    table = Table(title=f"{result.executor}, {result.cores} cores{pinned}")
    for name in ("cells", "trials", "s", "trials/s", "of linear", "a stack's start, s"):
        table.add_column(name, justify="right")
    for rate in result.rates:
        table.add_row(
            str(rate.cells), str(rate.trials), f"{rate.elapsed_s:.1f}", f"{rate.trials_s:.3f}", f"{rate.linear:.0%}",
            f"{rate.slowest_start_s:.1f}",
        )  # fmt: skip
    return table
