"""The progress of a long command and the time left: a bar in a terminal.

In a log or a pipe, where a bar cannot be drawn, one line a minute.
"""

from __future__ import annotations

import threading
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from services.operator.cli.time_left import in_words

LINE_S = 60.0
SPEED_OVER_S = 1800.0  # a unit of work takes seconds or minutes: fewer than two of them give no speed


class Bar(Progress):
    """Rich's Progress with a description, a bar, `done of all` where `counted`, and times; then a task's field
    `beside`.

    Without a console it is silent. `line_s`: the time between two lines where no bar can be drawn.
    """

    def __init__(self, console: Console | None, *, counted: bool = True, line_s: float = LINE_S) -> None:
        counts: tuple[ProgressColumn, ...] = (MofNCompleteColumn(),) if counted else ()
        super().__init__(
            TextColumn("{task.description}"), BarColumn(), *counts, TimeElapsedColumn(), TimeRemainingColumn(),
            TextColumn("{task.fields[beside]}"), console=console, disable=console is None,
            speed_estimate_period=SPEED_OVER_S,
        )  # fmt: skip
        self._counted, self._line_s = counted, line_s
        self._ended = threading.Event()
        self._lines: threading.Thread | None = None

    def add_task(
        self, description: str, start: bool = True, total: float | None = 100.0, completed: int = 0,
        visible: bool = True, **fields: Any,
    ) -> TaskID:  # fmt: skip
        """See Progress."""
        return super().add_task(description, start, total, completed, visible, **{"beside": "", **fields})

    def start(self) -> None:
        """Show the bar, or start printing lines."""
        super().start()
        if not self.disable and not self.console.is_interactive and self._lines is None:
            self._ended.clear()
            self._lines = threading.Thread(target=self._say_lines, name="progress-lines", daemon=True)
            self._lines.start()

    def stop(self) -> None:
        """Show it for the last time."""
        self._ended.set()
        if self._lines is not None:
            self._lines.join()
            self._lines = None
        super().stop()

    def _say_lines(self) -> None:
        while not self._ended.wait(self._line_s):
            for line in self.lines():
                self.console.print(line, markup=False, highlight=False, soft_wrap=True)

    def lines(self) -> list[str]:
        """The progress of each unfinished task, as plain text."""
        said = []
        for task in self.tasks:
            if task.total is not None and task.completed >= task.total:
                continue
            share = f"{task.completed:.0f} of {task.total or 0.0:.0f}" if self._counted else f"{task.percentage:.0f} %"
            left = "" if task.time_remaining is None else f", about {in_words(task.time_remaining)} left"
            after = f"after {(task.elapsed or 0.0) / 60.0:.0f} min{left}"
            line = f"{task.description}: {share} {after}  {task.fields['beside']}"
            said.append(Text.from_markup(line).plain.rstrip())
        return said
