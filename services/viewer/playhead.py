"""Where in a recording the page is."""

from __future__ import annotations

import threading
from bisect import bisect_left, bisect_right
from collections.abc import Sequence

SPEEDS = ("0.1", "0.5", "1", "2", "5")


class Playhead:
    """A time between `first_s` and `last_s` that runs at `speed` while it plays; several threads may turn it."""

    def __init__(self, first_s: float, last_s: float, marks_s: Sequence[float] = ()) -> None:
        self.first_s, self.last_s = first_s, last_s
        self._marks_s = sorted(mark for mark in marks_s if first_s <= mark <= last_s)
        self._lock = threading.Lock()
        self._now_s, self._playing, self._speed = first_s, False, 1.0

    @property
    def now_s(self) -> float:
        """Where it is."""
        with self._lock:
            return self._now_s

    @property
    def playing(self) -> bool:
        """Whether it runs."""
        with self._lock:
            return self._playing

    def play(self) -> None:
        """Run; from the start where it is at the end."""
        with self._lock:
            if self._now_s >= self.last_s:
                self._now_s = self.first_s
            self._playing = True

    def pause(self) -> None:
        """Stand still."""
        with self._lock:
            self._playing = False

    def speed(self, factor: float) -> None:
        """So many seconds of the recording in one."""
        with self._lock:
            self._speed = factor

    def seek(self, at_s: float) -> None:
        """Go there."""
        with self._lock:
            self._now_s = min(max(at_s, self.first_s), self.last_s)

    def step(self, forwards: bool) -> None:
        """Go to the next mark, or to the one before, and stand still."""
        with self._lock:
            self._playing = False
            if forwards:
                later = self._marks_s[bisect_right(self._marks_s, self._now_s + 1e-6) :]
                self._now_s = later[0] if later else self.last_s
            else:
                earlier = self._marks_s[: bisect_left(self._marks_s, self._now_s - 1e-6)]
                self._now_s = earlier[-1] if earlier else self.first_s

    def advance(self, wall_s: float) -> float:
        """So much wall time has passed: where it is now. At the end it stands still."""
        with self._lock:
            if self._playing:
                self._now_s += wall_s * self._speed
                if self._now_s >= self.last_s:
                    self._now_s, self._playing = self.last_s, False
            return self._now_s
