"""Counters of samples sent, received, dropped and rejected, for each key."""

from __future__ import annotations

import threading
import time

from crosspih_common.messages.status import KeyTraffic

KINDS = ("out", "received", "dropped", "rejected")
MAX_KEYS = 1024  # a cell has some 200
OTHERS = "others"  # all keys above MAX_KEYS together


class KeyCounters:
    """The counters of one key; callers add to them: `counts.received += 1`. They have no lock, because they change with
    every sample: one thread at a time sends or receives the samples of a key."""

    __slots__ = KINDS

    def __init__(self) -> None:
        self.out = self.received = self.dropped = self.rejected = 0

    def now(self) -> dict[str, int]:
        """The present values of all counters."""
        return {"out": self.out, "received": self.received, "dropped": self.dropped, "rejected": self.rejected}


class Traffic:
    """Counters by key, readable from any thread. At most MAX_KEYS keys are counted separately: a sender can invent keys
    where its name is part of the key, and each status message carries all of them. Rates are over the wall time between
    two calls of `snapshot`, for display only."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: dict[str, KeyCounters] = {}
        self._before: dict[str, tuple[int, int]] = {}
        self._before_at = time.monotonic()
        self.last_rejection = ""

    def of(self, key: str) -> KeyCounters:
        """The counters of one key."""
        counts = self._counts.get(key)
        if counts is None:
            with self._lock:
                known = key if key in self._counts or len(self._counts) < MAX_KEYS else OTHERS
                counts = self._counts.setdefault(known, KeyCounters())
        return counts

    def reject(self, key: str, why: str) -> None:
        """Count a rejected message and remember why."""
        self.of(key).rejected += 1
        self.last_rejection = why

    def _now(self) -> dict[str, dict[str, int]]:
        with self._lock:
            counts = list(self._counts.items())
        return {key: found for key, each in counts if any((found := each.now()).values())}

    def total(self, kind: str) -> int:
        """One counter over all keys."""
        return sum(counts[kind] for counts in self._now().values())

    def snapshot(self) -> tuple[KeyTraffic, ...]:
        """All counters that have counted anything, with rates since the last snapshot."""
        found = self._now()
        with self._lock:
            now = time.monotonic()
            elapsed = max(now - self._before_at, 1e-3)
            rows = []
            for key, counts in sorted(found.items()):
                out, received = self._before.get(key, (0, 0))
                rows.append(
                    KeyTraffic(
                        key=key,
                        out_hz=round((counts["out"] - out) / elapsed, 2),
                        in_hz=round((counts["received"] - received) / elapsed, 2),
                        **counts,
                    )
                )
            self._before = {key: (counts["out"], counts["received"]) for key, counts in found.items()}
            self._before_at = now
            return tuple(rows)
