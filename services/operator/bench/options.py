"""The options of every bench of trials, and its exit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.provenance import ResultStore
from services.operator.assembly.as_bench import watch_command
from services.operator.bench.cells.pool import ExecutorName
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import TrialJob, TrialsEnded, TrialsStopped, run_trials
from services.operator.cli.failure import CommandFailure, Failed
from services.operator.cli.failure import errors_shown as failures_shown
from services.operator.cli.options import AsJson as AsJson
from services.operator.scoring.score import TrialFigures

Cells = Annotated[int | None, typer.Option(min=1, help="Cells side by side; one a core when left out.")]
Where = Annotated[ExecutorName, typer.Option("--executor", help="Cells on this machine, or on a Ray cluster's.")]
RayAddress = Annotated[
    str | None, typer.Option(help="A running cluster's, such as 10.0.0.1:6379 or auto; else Ray is started here.")
]
Store = Annotated[
    Path | None, typer.Option(help="Results as JSON lines: results in it are not made again, new ones are added.")
]


@contextmanager
def errors_shown(console: Console) -> Iterator[None]:
    """Prints errors as every command does (cli/failure.py); a bench that was stopped says that it can be resumed."""
    with failures_shown(console):
        try:
            yield
        except TrialsStopped as stopped:
            said = f"{stopped}; the same command goes on from there"
            console.print(said, highlight=False)
            raise Failed(CommandFailure("stopped", said), 130) from None


def trials_of(
    console: Console,
    title: str,
    jobs: list[TrialJob],
    *,
    cells: int | None,
    executor: ExecutorName,
    ray_address: str | None,
    store: Path | None,
    record: bool = False,
    on_done: Callable[[TrialJob, TrialFigures], object] = lambda job, figures: None,
) -> tuple[list[tuple[TrialJob, TrialFigures]], TrialsEnded | None]:
    """The trials of a bench with its progress and failures shown: (job, figures) in the jobs' order, and the reason why
    the run ended early, if it did. Raises ConfigError.
    """
    progress = CellsProgress(console, title)
    counts = [0, 0]

    def count(job: TrialJob, figures: TrialFigures) -> None:
        counts[0] += 1
        counts[1] += figures.inserted
        progress.describe(f"{title}: {counts[1]} of {counts[0]} in")
        if not figures.inserted:
            named = "" if job.condition.name == "default" else f"{job.condition.name}, "
            progress.say(
                f"{named}{job.strategy.value}, seed {job.seed}: {figures.failure} {figures.failure_detail}", "red"
            )
            progress.say(f"  watch it: {watch_command(job)}")
        on_done(job, figures)

    return run_kept(jobs, progress, cells, executor, ray_address, store, record, count)


def run_kept(
    jobs: list[TrialJob],
    progress: CellsProgress,
    cells: int | None,
    executor: ExecutorName,
    ray_address: str | None,
    store: Path | None,
    record: bool = False,
    on_done: Callable[[TrialJob, TrialFigures], object] = lambda job, figures: None,
) -> tuple[list[tuple[TrialJob, TrialFigures]], TrialsEnded | None]:
    """As `trials_of`, with a progress of the bench's own."""
    kept = None if store is None else ResultStore(store)
    try:
        done = run_trials(
            jobs, cells=cells, executor=executor, ray_address=ray_address, store=kept, record=record, on_done=on_done,
            progress=progress,
        )  # fmt: skip
    except TrialsEnded as ended:
        return ended.done, ended
    finally:
        if kept is not None:
            kept.close()
    return list(zip(jobs, done, strict=True)), None
