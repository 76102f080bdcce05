"""The result of the pushes so far, in a table that is updated after each: the uncertainty of each number, and what is
missing.
"""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from crosspih_common.calibration.fitting import CalibrationRefused
from crosspih_common.calibration.presses import Pressed
from services.operator.calibrate.tables import values_table


class SoFar:
    """A live table below the printed lines, in a terminal only; nothing of it goes into a file or a pipe."""

    def __init__(self, console: Console, title: str, reckon: Callable[[Pressed], dict[str, Any]]) -> None:
        self._title, self._reckon = title, reckon
        self._live = Live(Text(""), console=console, transient=True, auto_refresh=False)
        self._on = console.is_terminal

    def __enter__(self) -> SoFar:
        if self._on:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._on:
            self._live.stop()

    def show(self, pressed: Pressed) -> None:
        """Show the result of all data so far."""
        if self._on:
            self._live.update(self.told(pressed), refresh=True)

    def told(self, pressed: Pressed) -> Group:
        """The table, and what is missing."""
        try:
            found = self._reckon(pressed)
        except CalibrationRefused as refusal:
            return Group(Text(f"not yet: {refusal}", style="yellow"))
        table = values_table(f"{self._title}, after {len(pressed.presses)} pushes", found["values"])
        lines = (Text(f"missing: {line}", style="yellow") for line in found["missing"])
        return Group(table, *lines)
