"""The time that is left, estimated from the time of the parts that are done: for lines, where no bar can be drawn."""

from __future__ import annotations

import time
from collections.abc import Callable


def in_words(seconds: float) -> str:
    """40 s, 3 min, 2.1 h."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


class TimeLeft:
    """The time left for `total` parts that take about as long each, from now on."""

    def __init__(self, total: int, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._total, self._clock_s, self._began_s = total, clock_s, clock_s()

    def after(self, done: int) -> str:
        """`, about 3 min left`; empty before the first part and after the last."""
        if not 0 < done < self._total:
            return ""
        spent_s = self._clock_s() - self._began_s
        return f", about {in_words(spent_s / done * (self._total - done))} left"
