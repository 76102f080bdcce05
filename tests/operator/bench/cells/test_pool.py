"""Which cell does what, what happens when one is lost, and that a trial is the same in every cell."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.errors import ConfigError, CrosspihError
from crosspih_common.provenance import ResultStore, code_version
from services.operator.assembly.session import Session
from services.operator.bench.cells.conditions import cell_content
from services.operator.bench.cells.local_executor import LocalExecutor
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.pool import HOPELESS, TRIES, ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.ray_executor import RayExecutor
from services.operator.bench.cells.trials import (
    WALL_FIGURES,
    TrialJob,
    base_cell_text,
    run_trials,
    trial_key,
    trial_task,
)
from services.operator.bench.cells.worker import Outcome

SILENT = CellsProgress(None)


class PlannedExecutor:
    """Cells that answer at once: with the task's payload, or by being lost as often as the plan says."""

    def __init__(self, cells: int, losses: dict[int, int]) -> None:
        self.cells = cells
        self._losses = dict(losses)
        self._running: dict[int, CellTask] = {}
        self.stacks = 0
        self.asked = 0
        self.last: dict[int, CellTask] = {}

    def submit(self, cell: int, task: CellTask) -> None:
        assert cell not in self._running, "a cell does one task at a time"
        self._running[cell] = task
        self.asked += 1
        if not task.same_cell(self.last.get(cell)):
            self.stacks += 1
        self.last[cell] = task

    def wait(self, busy: list[int], timeout_s: float) -> list[tuple[int, Outcome]]:
        assert busy == sorted(self._running)
        cell = busy[-1]
        task = self._running.pop(cell)
        if self._losses.get(task.payload, 0) > 0:
            self._losses[task.payload] -= 1
            return [(cell, Outcome(lost="its stack died"))]
        return [(cell, Outcome(task.payload))]

    def close(self) -> None: ...


def _nothing(session: Session, payload: Any) -> Any:
    return payload


def _tasks(kinds: list[int]) -> list[CellTask]:
    return [CellTask(f"{index}", {"cell": {"kind": kind}}, _nothing, index) for index, kind in enumerate(kinds)]


@settings(deadline=None)
@given(
    st.lists(st.integers(0, 3), max_size=12),
    st.integers(1, 4),
    st.dictionaries(st.integers(0, 11), st.integers(1, 3), max_size=4),
)
def test_every_task_is_done_once_or_named_as_lost(kinds: list[int], cells: int, losses: dict[int, int]) -> None:
    done: dict[int, Any] = {}

    def on_result(index: int, result: Any) -> None:
        assert index not in done
        done[index] = result

    lost = run_in_cells(_tasks(kinds), PlannedExecutor(cells, losses), on_result, SILENT)
    expected = {index for index, times in losses.items() if times >= TRIES and index < len(kinds)}
    assert set(done) | set(lost) == set(range(len(kinds))) and not set(done) & set(lost)
    assert all(result == index for index, result in done.items())
    # what is lost without having been tried is of a kind that lost others and did nothing
    assert expected <= set(lost)
    for index in set(lost) - expected:
        assert "not tried" in lost[index]
        of_kind = [other for other, kind in enumerate(kinds) if kind == kinds[index]]
        assert len(expected & set(of_kind)) >= HOPELESS and not set(done) & set(of_kind)


def test_what_was_given_up_is_done_when_a_cell_comes_up_after_all() -> None:
    """Tasks 1 and 2 are lost while task 0 is still at work; it is done, so 3 to 5 are worth a try again."""
    executor = PlannedExecutor(2, {1: TRIES, 2: TRIES})
    lost = run_in_cells(_tasks([0] * 6), executor, lambda index, result: None, SILENT)
    assert set(lost) == {1, 2} and len(lost) == HOPELESS


def test_a_cell_that_never_comes_up_is_not_tried_for_every_seed() -> None:
    executor = PlannedExecutor(2, dict.fromkeys(range(50), 9))
    lost = run_in_cells(_tasks([0] * 50 + [1] * 4), executor, lambda index, result: None, SILENT)
    assert set(lost) == set(range(50))
    assert executor.asked < 4 + 3 * TRIES * HOPELESS


def test_a_cell_keeps_its_stack_as_long_as_it_can() -> None:
    executor = PlannedExecutor(2, {})
    run_in_cells(_tasks([0, 1, 0, 1, 0, 1, 0, 1]), executor, lambda index, result: None, SILENT)
    # one for each kind, and one where a cell that has nothing left to do helps the other
    assert executor.stacks <= 3


def _pid(session: Session, payload: Any) -> int:
    return os.getpid()


def _die_once(session: Session, payload: str) -> str:
    flag = Path(payload)
    if not flag.exists():
        flag.touch()
        os._exit(3)
    return session.cell.workcell.name


def _refuse(session: Session, payload: Any) -> None:
    raise CrosspihError("no such luck")


def _bare(label: str, work: Any, payload: Any = None) -> CellTask:
    """A task in a cell that is a router only: it is up within a second."""
    return CellTask(label, {}, work, payload, services=(), calibrate=False)


@pytest.fixture
def cells_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where the workers' cells are made; its name is short, for there are sockets below it."""
    with tempfile.TemporaryDirectory(prefix="cells-") as folder:
        monkeypatch.setenv("TMPDIR", folder)
        yield Path(folder)


def test_a_worker_that_dies_is_replaced_and_leaves_nothing_behind(tmp_path: Path, cells_folder: Path) -> None:
    executor = LocalExecutor(1)
    found: dict[int, Any] = {}
    try:
        tasks = [
            _bare("dies", _die_once, str(tmp_path / "flag")),
            _bare("refuses", _refuse),
            _bare("a", _pid),
            _bare("b", _pid),
        ]
        lost = run_in_cells(tasks, executor, found.__setitem__, SILENT)
    finally:
        executor.close()
    assert set(lost) == {1} and "no such luck" in lost[1]
    assert found[0] == "bench-0"
    assert found[2] == found[3] != os.getpid()
    # the dead worker's stack is stopped by its lifeline
    deadline = time.monotonic() + 60.0
    while list(cells_folder.glob("crosspih-bench-*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not list(cells_folder.glob("crosspih-bench-*"))


def _made(executor: LocalExecutor, cells: list[int]) -> dict[int, dict[str, Any]]:
    """What each of these busy cells comes back with."""
    found: dict[int, dict[str, Any]] = {}
    deadline = time.monotonic() + 200.0
    while len(found) < len(cells) and time.monotonic() < deadline:
        for cell, outcome in executor.wait([cell for cell in cells if cell not in found], 1.0):
            assert outcome.lost is None, outcome.lost
            found[cell] = outcome.result
    return found


def test_a_trial_is_the_same_in_every_cell_and_is_not_done_again(tmp_path: Path) -> None:
    """One seed in two cells side by side, in one of them after another trial; then taken from the store."""
    job, other = TrialJob(seed=1001), TrialJob(seed=1000)
    content = cell_content(base_cell_text(), job.condition)
    executor = LocalExecutor(2)
    try:
        executor.submit(0, trial_task(other, content))
        executor.submit(1, trial_task(job, content))
        first = _made(executor, [0, 1])
        executor.submit(0, trial_task(job, content))
        again = _made(executor, [0])[0]
    finally:
        executor.close()
    there, here, different = (
        {name: value for name, value in result.items() if name not in WALL_FIGURES}
        for result in (first[1], again, first[0])
    )
    assert here == there != different
    assert here["inserted"] and here["seed"] == 1001
    made: list[int] = []
    with ResultStore(tmp_path / "trials.jsonl") as store:
        store.put(trial_key(content, job, code_version()), again)
        known = run_trials([job], store=store, on_done=lambda job, figures: made.append(job.seed))
    assert not made
    assert [one.model_dump() for one in known] == [again]


@pytest.mark.filterwarnings("ignore")  # of Ray's own
def test_ray_does_the_same_tasks() -> None:
    pytest.importorskip("ray")
    executor = RayExecutor(1)
    found: dict[int, Any] = {}
    try:
        lost = run_in_cells([_bare("a", _pid), _bare("b", _pid)], executor, found.__setitem__, SILENT)
    finally:
        executor.close()
    assert not lost
    assert found[0] == found[1] != os.getpid()


def test_an_address_is_for_ray_only() -> None:
    with pytest.raises(ConfigError, match="--ray-address"):
        open_executor(ExecutorName.LOCAL, 1, 1, "auto")
