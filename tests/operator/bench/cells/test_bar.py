"""How far a bench is, where no bar can be drawn: in plain lines."""

from __future__ import annotations

import io
import threading

from rich.console import Console

from services.operator.bench.cells.bar import Bar
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.progress import CellsProgress

DEADLINE_S = 20.0


class Heard(io.StringIO):
    """A log that tells when it says something."""

    def __init__(self, wanted: str) -> None:
        super().__init__()
        self._wanted, self.said = wanted, threading.Event()

    def write(self, text: str) -> int:
        count = super().write(text)
        if self._wanted in self.getvalue():
            self.said.set()
        return count


def test_a_log_gets_lines_of_what_is_under_way() -> None:
    log = Heard("pushes: 2 of 5 after 0 min  [0] touching\n")
    console = Console(file=log, force_terminal=False, width=40)
    with Bar(console, line_s=0.01) as bar:
        bar.add_task("done already", total=3, completed=3)
        task = bar.add_task("pushes", total=5, beside="\\[0] touching")
        bar.advance(task, 2)
        assert log.said.wait(DEADLINE_S), log.getvalue()
    assert "done already: " not in log.getvalue()
    ended = log.getvalue()
    assert "2/5" in ended, "the bar once, at the end"


def test_a_terminal_has_the_bar_alone() -> None:
    log = Heard("pushes: ")
    with Bar(Console(file=log, force_terminal=True, width=80), line_s=0.01) as bar:
        bar.advance(bar.add_task("pushes", total=5), 2)
    assert not log.said.is_set() and "2/5" in log.getvalue()


def test_what_each_cell_is_at_is_told_too() -> None:
    progress = CellsProgress(Console(file=io.StringIO()), "trials")
    progress.taken_over(10, 4)
    progress.began(1, CellTask("fused 7", {}, lambda session, payload: None, None), new_cell=True)
    assert progress.bar.lines() == ["trials: 4 of 10 after 0 min  [1] starting for fused 7"]


def test_parts_of_a_time_are_told_as_a_share() -> None:
    bar = Bar(None, counted=False)
    bar.add_task("soak", total=3600.0, completed=900)
    assert bar.lines() == ["soak: 25 % after 0 min"]


def test_a_line_says_how_long_it_will_still_take_also_of_parts_that_take_minutes() -> None:
    times_s = [0.0]
    bar = Bar(Console(file=io.StringIO(), get_time=lambda: times_s[-1]))
    task = bar.add_task("by ur", total=10)
    for minutes in (3, 6, 9):
        times_s.append(minutes * 60.0)
        bar.advance(task)
    assert bar.lines() == ["by ur: 3 of 10 after 9 min, about 21 min left"]
