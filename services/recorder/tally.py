"""What did not get into the file, key by key."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping

from crosspih_common.recording.numbering import Line

RATE_HZ = 100.0  # of a key of which the table says nothing


class Tally:
    """Counts, per key: samples that overflowed here, that the disk did not take (`unwritten`), that never came (`gaps`
    in `seq`), malformed ones and refused ones.

    What follows from numbers is in crosspih_common/recording/numbering.py: `restarts` of publishers, and `strays`.
    """

    KINDS = ("overflow", "unwritten", "gaps", "malformed", "restarts", "strays", "refused")
    LOST = ("overflow", "unwritten", "gaps", "malformed")

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._lines: dict[str, Line] = {}
        self._heard: Counter[str] = Counter()
        self._counts: dict[str, Counter[str]] = {
            kind: Counter() for kind in self.KINDS if kind not in ("gaps", "restarts", "strays")
        }

    def arrived(self, key: str, seq: int, now_s: float, rate_hz: float | None = None) -> None:
        """A sample with this number came (or was seen to come and then overflowed)."""
        with self._lock:
            self._heard[key] += 1
            if seq < 0:
                return
            line = self._lines.get(key)
            if line is None:
                self._lines[key] = Line(seq + 1, now_s)
            else:
                line.hear(seq, now_s, RATE_HZ if rate_hz is None else rate_hz)

    def count(self, kind: str, key: str, amount: int = 1) -> None:
        """Add to an overflow, unwritten, malformed or refused count."""
        with self._lock:
            self._counts[kind][key] += amount

    def begin(self) -> None:
        """A new recording: all counts from zero; the numbers go on."""
        with self._lock:
            self._heard.clear()
            for counter in self._counts.values():
                counter.clear()
            for line in self._lines.values():
                line.begin()

    def counts(self) -> dict[str, dict[str, int]]:
        """Each kind's counts, key by key, none of zero; and `heard`, how many samples came."""
        with self._lock:
            found = {kind: dict(counter) for kind, counter in self._counts.items()}
            found["gaps"] = {key: number for key, line in self._lines.items() if (number := line.missing())}
            found["restarts"] = {key: line.restarts for key, line in self._lines.items() if line.restarts}
            found["strays"] = {key: line.strays for key, line in self._lines.items() if line.strays}
            found["heard"] = dict(self._heard)
            return found

    def lost(self) -> dict[str, int]:
        """Samples missing from the file: overflow, unwritten, gaps and malformed together."""
        counts = self.counts()
        total: Counter[str] = Counter()
        for kind in self.LOST:
            total.update(counts[kind])
        return dict(sorted(total.items()))

    def metadata(self) -> Mapping[str, str]:
        """For the file: a total of each kind, and `<kind> <key>` for each key that has any."""
        counts = self.counts()
        entries = {f"{kind}_total": str(sum(counts[kind].values())) for kind in self.KINDS}
        for kind in self.KINDS:
            entries.update({f"{kind} {key}": str(number) for key, number in sorted(counts[kind].items())})
        return entries
