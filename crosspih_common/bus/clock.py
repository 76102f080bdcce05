"""The cell's clock as a service sees it: the newest stamp it has seen from the cell."""

from __future__ import annotations

import threading


class BusClock:
    """Cell time, ns. It moves only by what comes over the bus; the wall clock has no part in it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._now_ns = 0
        self._boot_id = ""

    def now_ns(self) -> int:
        """The newest cell time known here."""
        return self._now_ns

    def observe(self, stamp_ns: int, boot_id: str | None = None) -> None:
        """Learn a stamp. A new boot id starts the clock anew: the cell was started again."""
        with self._lock:
            if boot_id is not None and boot_id != self._boot_id:
                self._boot_id = boot_id
                self._now_ns = stamp_ns
            elif stamp_ns > self._now_ns:
                self._now_ns = stamp_ns
