"""The current time of the playback."""

from __future__ import annotations

import threading
from bisect import bisect_left, bisect_right
from collections.abc import Sequence

SPEEDS = ("0.1", "0.5", "1", "2", "5")


class Playhead:
    """A time between `first_s` and `last_s` that runs at `speed` while it plays; several threads may change it."""

    def __init__(self, first_s: float, last_s: float, marks_s: Sequence[float] = ()) -> None:
        self.first_s, self.last_s = first_s, last_s
        self._marks_s = sorted(mark for mark in marks_s if first_s <= mark <= last_s)
        self._lock = threading.Lock()
        self._now_s, self._playing, self._speed = first_s, False, 1.0

    @property
    def now_s(self) -> float:
        """The current time."""
        with self._lock:
            return self._now_s

    @property
    def playing(self) -> bool:
        """Whether it runs."""
        with self._lock:
            return self._playing

    def play(self) -> None:
        """Play; from the start if it is at the end."""
        with self._lock:
            if self._now_s >= self.last_s:
                self._now_s = self.first_s
            self._playing = True

    def pause(self) -> None:
        """Stop playing."""
        with self._lock:
            self._playing = False

    def speed(self, factor: float) -> None:
        """Set how many seconds of the recording pass in one second."""
        with self._lock:
            self._speed = factor

    def seek(self, at_s: float) -> None:
        """Jump to a time."""
        with self._lock:
            self._now_s = min(max(at_s, self.first_s), self.last_s)

    def step(self, forwards: bool) -> None:
        """Jump to the next mark, or to the one before, and stop playing."""
        with self._lock:
            self._playing = False
            if forwards:
                later = self._marks_s[bisect_right(self._marks_s, self._now_s + 1e-6) :]
                self._now_s = later[0] if later else self.last_s
            else:
                earlier = self._marks_s[: bisect_left(self._marks_s, self._now_s - 1e-6)]
                self._now_s = earlier[-1] if earlier else self.first_s

    def advance(self, wall_s: float) -> float:
        """Let this much wall time pass; returns the current time. At the end it stops."""
        with self._lock:
            if self._playing:
                self._now_s += wall_s * self._speed
                if self._now_s >= self.last_s:
                    self._now_s, self._playing = self.last_s, False
            return self._now_s
