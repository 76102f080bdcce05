"""Assigns tasks to cells, repeats them once where a cell was lost, and loses no result when stopped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Any, Protocol

from crosspih_common.errors import ConfigError
from services.operator.bench.cells.local_executor import LocalExecutor, usable_cores
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.ray_executor import RayExecutor
from services.operator.bench.cells.worker import Outcome

TRIES = 2
# a kind of cell that has lost this many tasks for good, and done none, is given up
HOPELESS = 2
_POLL_S = 0.5


class ExecutorName(str, Enum):
    """Where the cells are."""

    LOCAL = "local"  # processes of this machine
    RAY = "ray"  # actors of a Ray cluster, or of a Ray started for this run


class Executor(Protocol):
    """Cells, numbered from 0, that each do one task at a time."""

    @property
    def cells(self) -> int:
        """How many there are."""

    def submit(self, cell: int, task: CellTask) -> None:
        """Give an idle cell a task."""

    def wait(self, busy: list[int], timeout_s: float) -> list[tuple[int, Outcome]]:
        """The outcomes that have come; none when the time is up."""

    def close(self) -> None:
        """Stop all cells."""


class Watcher(Protocol):
    """Is informed of the progress."""

    def began(self, cell: int, task: CellTask, new_cell: bool) -> None:
        """A cell has taken a task; `new_cell`: it starts a stack first."""

    def ended(self, cell: int, task: CellTask, outcome: Outcome, again: bool) -> None:
        """A cell has done a task, or lost it; `again`: it will be tried once more."""


def open_executor(
    name: ExecutorName, cells: int | None, tasks: int, ray_address: str | None = None, one_core_each: bool = False
) -> Executor:
    """The executor; never more cells than tasks. Without `cells`, one a core. With `one_core_each` a local cell never
    leaves its core (Ray minds its own cores). Raises ConfigError."""
    if name is ExecutorName.RAY:
        return RayExecutor(None if cells is None else max(1, min(cells, tasks)), ray_address)
    if ray_address is not None:
        raise ConfigError("--ray-address: only with --executor ray")
    return LocalExecutor(max(1, min(cells or usable_cores(), tasks)), one_core_each)


class _Queue:
    """The remaining tasks, by the cell that they need."""

    def __init__(self, tasks: Sequence[CellTask]) -> None:
        self._tasks = tasks
        self._kinds: list[list[int]] = []
        for index, task in enumerate(tasks):
            for kind in reversed(self._kinds):
                if task.same_cell(tasks[kind[0]]):
                    kind.append(index)
                    break
            else:
                self._kinds.append([index])
        self._kind_of = {index: number for number, kind in enumerate(self._kinds) for index in kind}
        self._workers = [0] * len(self._kinds)
        self._done = [0] * len(self._kinds)
        self._lost = [0] * len(self._kinds)
        self._given_up: list[list[int]] = [[] for _ in self._kinds]
        self._why_given_up = [""] * len(self._kinds)

    def take(self, current: int | None) -> int | None:
        """The next task for a cell whose last one was `current`: of the same kind, else of the kind that has the most
        left per cell that works on it.
        """
        number = None if current is None else self._kind_of[current]
        if number is None or not self._kinds[number]:
            if number is not None:
                self._workers[number] -= 1
            left = [len(kind) / (1 + at) for kind, at in zip(self._kinds, self._workers, strict=True)]
            number = max(range(len(left)), key=lambda index: left[index], default=None)
            if number is None or not self._kinds[number]:
                return None
            self._workers[number] += 1
        return self._kinds[number].pop(0)

    def done(self, index: int) -> None:
        """A task is done, so its kind of cell works: its tasks that were given up are tried after all."""
        number = self._kind_of[index]
        self._done[number] += 1
        self._kinds[number] += self._given_up[number]
        self._given_up[number] = []

    def lost(self, index: int, why: str) -> None:
        """A task is lost for good. If this kind of cell has never done a task, the rest of its tasks are given up."""
        number = self._kind_of[index]
        self._lost[number] += 1
        if self._done[number] == 0 and self._lost[number] >= HOPELESS:
            self._given_up[number] += self._kinds[number]
            self._kinds[number] = []
            self._why_given_up[number] = why

    def given_up(self) -> dict[int, str]:
        """The tasks that were not tried, by index, with the reason."""
        pairs = zip(self._given_up, self._why_given_up, strict=True)
        return {index: f"not tried, for {why}" for kind, why in pairs for index in kind}

    def again(self, index: int) -> None:
        """Repeat a task, as the first of its kind: if no cell of that kind comes up, that is soon known."""
        self._kinds[self._kind_of[index]].insert(0, index)


def run_in_cells(
    tasks: Sequence[CellTask], executor: Executor, on_result: Callable[[int, Any], object], watcher: Watcher
) -> dict[int, str]:
    """Do all tasks; `on_result(index, result)` is called as each is done. Returns the lost tasks by index, with the
    reason.

    A task whose cell is lost is tried once more on a new stack. When a kind of cell has never done a task and has lost
    several, its other tasks are given up untried, unless one that was still running is done after all. The executor
    stays open. A KeyboardInterrupt is passed on: only the results given to `on_result` by then are done.
    """
    queue = _Queue(tasks)
    running: dict[int, int] = {}
    last: dict[int, int] = {}
    tries = [0] * len(tasks)
    lost: dict[int, str] = {}
    idle = list(range(executor.cells))
    while True:
        waiting: list[int] = []
        for cell in idle:
            index = queue.take(last.get(cell))
            if index is None:
                last.pop(cell, None)
                waiting.append(cell)
                continue
            before = last.get(cell)
            new = before is None or not tasks[index].same_cell(tasks[before])
            running[cell] = last[cell] = index
            watcher.began(cell, tasks[index], new)
            executor.submit(cell, tasks[index])
        idle = waiting
        if not running:
            return lost | queue.given_up()
        for cell, outcome in executor.wait(sorted(running), _POLL_S):
            index = running.pop(cell)
            idle.append(cell)
            tries[index] += 1
            again = outcome.lost is not None and tries[index] < TRIES
            watcher.ended(cell, tasks[index], outcome, again)
            if outcome.lost is None:
                queue.done(index)
                on_result(index, outcome.result)
            elif again:
                queue.again(index)
            else:
                lost[index] = outcome.lost
                queue.lost(index, outcome.lost)
