"""Keeps a clock that could run faster to the wall's."""

from __future__ import annotations

import time

_SLEEP_AHEAD_S = 0.002
_GIVE_UP_BEHIND_S = 0.5


class WallPace:
    """Keeps the cell's clock from running ahead of the wall's, or of so many times the wall's."""

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        self._anchor_s: float | None = None
        self._anchor_ns = 0

    def __call__(self, now_ns: int) -> None:
        """Wait until the wall clock has come as far. After a long stall it goes on from where it is."""
        wall_s = time.monotonic()
        if self._anchor_s is None:
            self._anchor_s, self._anchor_ns = wall_s, now_ns
            return
        ahead_s = (now_ns - self._anchor_ns) * 1e-9 / self._speed - (wall_s - self._anchor_s)
        if ahead_s < -_GIVE_UP_BEHIND_S:
            self._anchor_s, self._anchor_ns = wall_s, now_ns
        elif ahead_s > _SLEEP_AHEAD_S:
            time.sleep(ahead_s)
