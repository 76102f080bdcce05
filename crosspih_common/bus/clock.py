"""The cell's clock as a service sees it: the newest stamp it has seen from the cell."""

from __future__ import annotations

import threading

# A stamp further ahead of the newest tick is no news of this cell: it was given before the cell was started again.
AHEAD_NS = 1_000_000_000


class BusClock:
    """Cell time, ns. It moves only by what comes over the bus; the wall clock has no part in it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.newest_ns = 0  # to be looked at before a stamp is observed: one that is no newer is no news
        self._tick_ns = 0
        self._boot_id = ""

    def now_ns(self) -> int:
        """The newest cell time known here."""
        return self.newest_ns

    @property
    def boot_id(self) -> str:
        """Which run of the cell's clock this is; empty before its first tick."""
        return self._boot_id

    def observe(self, stamp_ns: int, boot_id: str | None = None) -> None:
        """Learn a stamp; with `boot_id`, a tick of the clock itself. A new boot id starts the clock anew.

        Between ticks any message's stamp moves the clock, but not one that is far ahead of the newest tick: what a
        service said before the cell was started again is still told to those who come late. Before the first tick
        nothing else moves it: whose stamp that is cannot be told.
        """
        if boot_id is None and stamp_ns <= self.newest_ns:
            return  # no news, as of most samples
        if boot_id is None and (not self._boot_id or stamp_ns > self._tick_ns + AHEAD_NS):
            return
        with self._lock:
            if boot_id is not None:
                if boot_id != self._boot_id:
                    self._boot_id = boot_id
                    self.newest_ns = self._tick_ns = stamp_ns
                self._tick_ns = max(self._tick_ns, stamp_ns)
            elif not self._boot_id or stamp_ns > self._tick_ns + AHEAD_NS:
                return
            self.newest_ns = max(self.newest_ns, stamp_ns)
