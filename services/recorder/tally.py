"""What did not get into the file, key by key."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping


class Tally:
    """Counts, per key: samples that overflowed here, samples that never came (gaps in `seq`), and malformed ones.

    A number lower than the one expected is a publisher that was started again; that is counted, and is no gap.
    """

    KINDS = ("overflow", "gaps", "malformed", "restarts")

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._expected: dict[str, int] = {}
        self._counts: dict[str, Counter[str]] = {kind: Counter() for kind in self.KINDS}

    def arrived(self, key: str, seq: int) -> None:
        """A sample with this number came (or was seen to come and then overflowed)."""
        if seq < 0:
            return
        with self._lock:
            expected = self._expected.get(key)
            if expected is not None and seq > expected:
                self._counts["gaps"][key] += seq - expected
            elif expected is not None and seq < expected:
                self._counts["restarts"][key] += 1
            self._expected[key] = seq + 1

    def count(self, kind: str, key: str) -> None:
        """Add one to an overflow or a malformed count."""
        with self._lock:
            self._counts[kind][key] += 1

    def begin(self) -> None:
        """A new file: all counts from zero; the numbers go on."""
        with self._lock:
            for counter in self._counts.values():
                counter.clear()

    def lost(self) -> dict[str, int]:
        """Samples missing from the file: overflow, gaps and malformed together."""
        with self._lock:
            total = self._counts["overflow"] + self._counts["gaps"] + self._counts["malformed"]
            return dict(sorted(total.items()))

    def metadata(self) -> Mapping[str, str]:
        """For the file: a total of each kind, and `<kind> <key>` for each key that has any."""
        with self._lock:
            entries = {f"{kind}_total": str(sum(counter.values())) for kind, counter in self._counts.items()}
            for kind, counter in self._counts.items():
                entries.update({f"{kind} {key}": str(number) for key, number in sorted(counter.items())})
            return entries
