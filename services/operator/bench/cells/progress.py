"""The progress of a run in cells, for people: a bar for the whole, and the current task of each cell."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import TaskID

from services.operator.bench.cells.bar import Bar
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.worker import Outcome


class CellsProgress:
    """Implements Watcher on a console; without a console it keeps silent."""

    def __init__(self, console: Console | None, title: str = "trials") -> None:
        self._console = console
        self.title = title
        self.bar = Bar(console)
        self._task: TaskID | None = None
        self._states: dict[int, str] = {}

    def say(self, text: str, style: str = "") -> None:
        """Print a line above the bar."""
        if self._console is not None:
            self.bar.console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)

    def taken_over(self, total: int, known: int) -> None:
        """The number of tasks, and how many of them were taken from the store."""
        if known:
            self.say(f"{known} of {total} taken over from before")
        self._task = self.bar.add_task(self.title, total=total, completed=known)

    def describe(self, title: str) -> None:
        """Set the text before the bar."""
        self.title = title
        self._update()

    def began(self, cell: int, task: CellTask, new_cell: bool) -> None:
        """See Watcher."""
        self._states[cell] = ("starting for " if new_cell else "") + task.label
        self._update()

    def ended(self, cell: int, task: CellTask, outcome: Outcome, again: bool) -> None:
        """See Watcher."""
        self._states[cell] = "idle"
        if outcome.lost is not None:
            then = "once more on a new stack" if again else "given up"
            self.say(f"cell {cell}: {task.label} lost, {then}: {outcome.lost}", "yellow" if again else "red")
        elif self._task is not None:
            self.bar.advance(self._task)
        self._update()

    def _update(self) -> None:
        if self._task is not None:
            cells = "  ".join(f"[{cell}] {state}" for cell, state in sorted(self._states.items()))
            # square brackets would be taken for markup
            self.bar.update(self._task, description=self.title, beside=cells.replace("[", "\\["))

    def __enter__(self) -> CellsProgress:
        self.bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bar.stop()
