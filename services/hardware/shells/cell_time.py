"""The cell's time of an instant that only the host's clock has: for cameras, which know nothing of the arm's cycles."""

from __future__ import annotations

import threading
import time
from collections import deque

WINDOW_NS = 2_000_000_000


class CellTime:
    """Maps the host's monotonic clock to the cell's. A tick is heard late, never early: the least delayed of the last
    two seconds counts. Without ticks the cell's time is not known, and stamps only go onward."""

    def __init__(self) -> None:
        self._ticks: deque[tuple[int, int]] = deque()  # host's ns when it was heard, cell's time less that
        self._boot_id = ""
        self._newest_ns = 0
        self._last_ns = -1
        self._running = False
        self._lock = threading.Lock()

    def tick(self, stamp_ns: int, boot_id: str, realtime: bool) -> None:
        """The cell says its time."""
        host_ns = time.monotonic_ns()
        with self._lock:
            if boot_id != self._boot_id:
                self._boot_id = boot_id
                self._ticks.clear()
            self._newest_ns, self._running = stamp_ns, realtime
            self._ticks.append((host_ns, stamp_ns - host_ns))
            while self._ticks[0][0] < host_ns - WINDOW_NS:
                self._ticks.popleft()

    def stamp_ns(self, host_ns: int) -> int:
        """The cell's time of an instant; each stamp is later than the one before, for pairs are found by it."""
        with self._lock:
            stamp_ns = self._newest_ns
            if self._running:
                stamp_ns = host_ns + max(offset for _, offset in self._ticks)
            self._last_ns = max(stamp_ns, self._last_ns + 1, 0)
            return self._last_ns
