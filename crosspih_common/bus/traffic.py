"""Counters: what went out, came in, was dropped and was rejected, key by key."""

from __future__ import annotations

import threading
import time
from collections import defaultdict

from crosspih_common.messages.status import KeyTraffic

MOST_KEYS = 1024  # a cell has some 200
OTHERS = "others"  # all keys beyond


class Traffic:
    """Thread-safe counters, of MOST_KEYS keys each for itself: where the sender's name is part of a key anybody may
    invent keys, and each status carries all of them. Rates are over wall time between two calls of `snapshot`: they are
    for people only."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: dict[str, dict[str, int]] = defaultdict(lambda: dict.fromkeys(self.KINDS, 0))
        self._before: dict[str, tuple[int, int]] = {}
        self._before_at = time.monotonic()
        self.last_rejection = ""

    KINDS = ("out", "received", "dropped", "rejected")

    def count(self, key: str, kind: str, amount: int = 1) -> None:
        """Add to one counter of one key."""
        with self._lock:
            self._counts[self._known(key)][kind] += amount

    def reject(self, key: str, why: str) -> None:
        """Count a rejected message and remember why."""
        with self._lock:
            self._counts[self._known(key)]["rejected"] += 1
            self.last_rejection = why

    def _known(self, key: str) -> str:
        return key if key in self._counts or len(self._counts) < MOST_KEYS else OTHERS

    def total(self, kind: str) -> int:
        """One counter over all keys."""
        with self._lock:
            return sum(counts[kind] for counts in self._counts.values())

    def snapshot(self) -> tuple[KeyTraffic, ...]:
        """All counters, with rates since the last snapshot."""
        with self._lock:
            now = time.monotonic()
            elapsed = max(now - self._before_at, 1e-3)
            rows = []
            for key, counts in sorted(self._counts.items()):
                out, received = self._before.get(key, (0, 0))
                rows.append(
                    KeyTraffic(
                        key=key,
                        out_hz=round((counts["out"] - out) / elapsed, 2),
                        in_hz=round((counts["received"] - received) / elapsed, 2),
                        **counts,
                    )
                )
            self._before = {key: (counts["out"], counts["received"]) for key, counts in self._counts.items()}
            self._before_at = now
            return tuple(rows)
