"""Counters: what went out, came in, was dropped and was rejected, key by key."""

from __future__ import annotations

import threading
import time

from crosspih_common.messages.status import KeyTraffic

KINDS = ("out", "received", "dropped", "rejected")


class Counts:
    """The counters of one key."""

    __slots__ = ("_counts", "_lock")

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts = dict.fromkeys(KINDS, 0)

    def add(self, kind: str) -> None:
        """Add one to one of KINDS."""
        with self._lock:
            self._counts[kind] += 1

    def now(self) -> dict[str, int]:
        """All of them."""
        with self._lock:
            return dict(self._counts)


class Traffic:
    """Thread-safe counters. Rates are over wall time between two calls of `snapshot`: they are for people only."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: dict[str, Counts] = {}
        self._before: dict[str, tuple[int, int]] = {}
        self._before_at = time.monotonic()
        self.last_rejection = ""

    def of(self, key: str) -> Counts:
        """The counters of one key."""
        counts = self._counts.get(key)
        if counts is None:
            with self._lock:
                counts = self._counts.setdefault(key, Counts())
        return counts

    def reject(self, key: str, why: str) -> None:
        """Count a rejected message and remember why."""
        self.of(key).add("rejected")
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
