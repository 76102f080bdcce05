"""Cells on this machine: one worker process each, tasks and outcomes over a pipe."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import FrameType

from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.stopping import end_with_parent
from services.operator.bench.cells.worker import CellWorker, Outcome

_END_S = 20.0


def usable_cores() -> int:
    """The cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _serve(connection: Connection, index: int, core: int | None) -> None:
    """The worker's process: do the tasks that come until the pipe closes."""
    if core is not None and hasattr(os, "sched_setaffinity"):
        # the stack that it starts inherits this core
        os.sched_setaffinity(0, {core})

    def on_term(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # closing the cell must not be interrupted
        raise SystemExit(0)

    signal.signal(signal.SIGTERM, on_term)
    end_with_parent()
    worker = CellWorker(index)
    try:
        while True:
            task: CellTask | None = connection.recv()
            if task is None:
                return
            connection.send(worker.run(task))
    except (EOFError, BrokenPipeError):
        pass
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        worker.close()


class LocalExecutor:
    """Implements Executor with processes of this machine."""

    def __init__(self, cells: int, one_core_each: bool = False) -> None:
        self._cores = sorted(os.sched_getaffinity(0)) if one_core_each and hasattr(os, "sched_getaffinity") else []
        self._context = multiprocessing.get_context("spawn")
        self._workers: list[tuple[BaseProcess, Connection]] = [self._start(index) for index in range(cells)]

    @property
    def cells(self) -> int:
        """How many cells there are."""
        return len(self._workers)

    def _start(self, index: int) -> tuple[BaseProcess, Connection]:
        ours, theirs = self._context.Pipe()
        core = self._cores[index % len(self._cores)] if self._cores else None
        process = self._context.Process(target=_serve, args=(theirs, index, core), name=f"cell-{index}", daemon=True)
        process.start()
        theirs.close()
        return process, ours

    def submit(self, cell: int, task: CellTask) -> None:
        """Give an idle cell a task."""
        process, connection = self._workers[cell]
        try:
            connection.send(task)
        except (BrokenPipeError, ConnectionResetError):
            connection.close()
            process.join()
            self._workers[cell] = self._start(cell)
            self._workers[cell][1].send(task)

    def wait(self, busy: list[int], timeout_s: float) -> list[tuple[int, Outcome]]:
        """The outcomes that have come from busy cells; a worker that died is replaced and its task is lost."""
        of = {id(self._workers[cell][1]): cell for cell in busy}
        found: list[tuple[int, Outcome]] = []
        for ready in wait([self._workers[cell][1] for cell in busy], timeout_s):
            cell = of[id(ready)]
            process, connection = self._workers[cell]
            try:
                found.append((cell, connection.recv()))
            except (EOFError, ConnectionResetError):
                connection.close()
                process.join()
                self._workers[cell] = self._start(cell)
                found.append((cell, Outcome(lost=f"its worker ended with status {process.exitcode}")))
        return found

    def close(self) -> None:
        """Stop every cell and wait until it is gone."""
        for process, connection in self._workers:
            with contextlib.suppress(OSError, ValueError):
                connection.send(None)
            process.terminate()
        for process, connection in self._workers:
            process.join(_END_S)
            if process.is_alive():
                process.kill()
                process.join()
            connection.close()
        self._workers = []
