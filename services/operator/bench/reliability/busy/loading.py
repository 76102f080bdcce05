"""`crosspih bench busy`: assemblies while other processes keep the machine busy; none may be stopped by the lease."""

from __future__ import annotations

import multiprocessing
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median
from typing import Any

from pydantic import BaseModel, ConfigDict
from rich.table import Table

from crosspih_common.errors import CrosspihError
from crosspih_common.messages import Failure, Strategy
from services.operator.assembly.session import Session
from services.operator.bench.cells.stopping import end_with_parent
from services.operator.scoring.score import TrialFigures
from services.operator.scoring.statistics import sight_row, wilson95

# the results of an assembly that the lease or a service's link has stopped, though all services were alive
STOPPED = (Failure.ARM_STOPPED.value, Failure.SERVICE_LOST.value)
NO_RESULT = "no_result"


class Ended(BaseModel):
    """How one assembly ended. `stopped`: by the lease, for a service that was wrongly taken for lost, or without any
    result.
    """

    model_config = ConfigDict(frozen=True)

    seed: int
    inserted: bool
    stopped: bool
    failure: str | None
    detail: str
    wall_s: float | None
    looked: bool = False
    vision_refused: str = ""
    felt_for: bool = False


class BusyResult(BaseModel):
    """What `crosspih bench busy --json` prints."""

    model_config = ConfigDict(frozen=True)

    speed: str
    busy_processes: int
    cores: int
    inserted: int
    stopped: int
    assemblies: list[Ended]


def _spin() -> None:
    end_with_parent()
    number = 1
    while True:
        number = number * 1103515245 % 2147483647


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Run `count` processes that only compute, for as long as the block lasts."""
    context = multiprocessing.get_context("spawn")
    spinning = [context.Process(target=_spin, daemon=True) for _ in range(count)]
    try:
        for one in spinning:
            one.start()
        yield
    finally:
        for one in spinning:
            if one.pid is not None:
                one.kill()
                one.join()


def assemble_once(session: Session, payload: dict[str, Any]) -> dict[str, Any]:
    """The work of a CellTask: one trial, however it ends, as an Ended in plain data. A trial without a result counts as
    stopped, and is not tried again.
    """
    seed = payload["seed"]
    try:
        figures, _ = session.trial(seed, Strategy(payload["strategy"]), False)
    except CrosspihError as error:
        no_result = Ended(
            seed=seed, inserted=False, stopped=True, failure=NO_RESULT, detail=f"{type(error).__name__}: {error}",
            wall_s=None,
        )  # fmt: skip
        return no_result.model_dump()
    return ended(seed, figures).model_dump()


def ended(seed: int, figures: TrialFigures) -> Ended:
    """The figures of a trial that count here."""
    return Ended(
        seed=seed,
        inserted=figures.inserted,
        stopped=figures.failure in STOPPED,
        failure=figures.failure,
        detail=figures.failure_detail,
        wall_s=figures.wall_s,
        looked=figures.looked,
        vision_refused=figures.vision_refused,
        felt_for=figures.felt_for,
    )


def table_of(result: BusyResult) -> Table:
    """Counts and times."""
    walls = [one.wall_s for one in result.assemblies if one.wall_s is not None]
    count = len(result.assemblies)
    low, high = wilson95(result.stopped, count)
    table = Table(title=f"{count} assemblies at {result.speed}, {result.busy_processes} busy processes beside them")
    table.add_column("")
    table.add_column("", justify="right")
    table.add_row("cores", str(result.cores))
    table.add_row("inserted", f"{result.inserted} of {count}")
    table.add_row(*sight_row(result.assemblies))
    table.add_row("stopped by the lease, or by a service taken for lost", f"{result.stopped} of {count}")
    table.add_row("95 % Wilson interval of that", f"{low:.1%} to {high:.1%}")
    if walls:
        table.add_row("wall time, s, median and longest", f"{median(walls):.1f} / {max(walls):.1f}")
    for failure, times in Counter(one.failure for one in result.assemblies if not one.inserted).items():
        table.add_row(f"ended as {failure}", str(times))
    return table
