"""The cell's clock as a service sees it: the newest stamp it has seen from the cell."""

from __future__ import annotations

import threading

# A stamp further ahead of the newest tick is not of this run: it was given before the cell was started again.
AHEAD_NS = 1_000_000_000


class BusClock:
    """Cell time, ns. Only stamps received over the bus move it; the wall clock is not used."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.newest_ns = 0  # compare with it before calling `observe`: a stamp that is not newer changes nothing
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
        """Take in a stamp, ns; with `boot_id`, a tick of the clock itself. A new boot id starts the clock anew.

        Between ticks any message's stamp moves the clock, except a stamp far ahead of the newest tick: late readers
        still receive messages that a service sent before the cell was restarted. Before the first tick no other stamp
        moves it, because it is not known to which run of the cell the stamp belongs.
        """
        if boot_id is None and stamp_ns <= self.newest_ns:
            return  # not newer, as most samples are
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
