"""The samples that are missing from the file, key by key."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping

from crosspih_common.recording.numbering import Line

RATE_HZ = 100.0  # for a key for which the table names no rate


class KeyTally:
    """How many samples of one key came, and what their sequence numbers show; used by one thread at a time. `before`
    counts those samples in `heard` that came before the recording began.
    """

    __slots__ = ("_lock", "_rate_hz", "before", "heard", "line")

    def __init__(self, lock: threading.Lock, rate_hz: float) -> None:
        self._lock, self._rate_hz = lock, rate_hz
        self.heard = self.before = 0
        self.line: Line | None = None

    def count_sample(self, seq: int, now_s: float) -> None:
        """A sample with this number came; -1 where it has none."""
        self.heard += 1
        line = self.line
        if line is not None and line.expected == seq:  # true of nearly all samples; no other thread changes this
            line.expected = seq + 1
            line.heard_s = now_s
        elif seq >= 0:
            with self._lock:
                if line is None:
                    self.line = Line(seq + 1, now_s)
                else:
                    line.count_sample(seq, now_s, self._rate_hz)

    def begin(self) -> None:
        """A recording begins."""
        self.before = self.heard
        if self.line is not None:
            self.line.begin()


class Tally:
    """Counts per key: samples that overflowed here, that the disk did not take (`unwritten`), that never came (`gaps`
    in `seq`), malformed ones and refused ones.

    crosspih_common/recording/numbering.py has what follows from the numbers: `restarts` of publishers, and `strays`.
    """

    KINDS = ("overflow", "unwritten", "gaps", "malformed", "restarts", "strays", "refused")
    LOST = ("overflow", "unwritten", "gaps", "malformed")

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._accounts: dict[str, KeyTally] = {}
        self._counts: dict[str, Counter[str]] = {
            kind: Counter() for kind in self.KINDS if kind not in ("gaps", "restarts", "strays")
        }

    def account(self, key: str, rate_hz: float | None = None) -> KeyTally:
        """The account of one key."""
        with self._lock:
            return self._accounts.setdefault(key, KeyTally(self._lock, RATE_HZ if rate_hz is None else rate_hz))

    def arrived(self, key: str, seq: int, now_s: float, rate_hz: float | None = None) -> None:
        """Count a sample with this number that came (or that was seen to come and then overflowed)."""
        self.account(key, rate_hz).count_sample(seq, now_s)

    def count(self, kind: str, key: str, amount: int = 1) -> None:
        """Add to an overflow, unwritten, malformed or refused count."""
        with self._lock:
            self._counts[kind][key] += amount

    def begin(self) -> None:
        """Begin a new recording: all counts start from zero; the sequence numbers go on."""
        with self._lock:
            for counter in self._counts.values():
                counter.clear()
            for account in self._accounts.values():
                account.begin()

    def counts(self) -> dict[str, dict[str, int]]:
        """Counts of each kind, key by key, without zeros; and `heard`, how many samples came."""
        with self._lock:
            found = {kind: dict(counter) for kind, counter in self._counts.items()}
            lines = {key: account.line for key, account in self._accounts.items() if account.line is not None}
            found["gaps"] = {key: number for key, line in lines.items() if (number := line.missing())}
            found["restarts"] = {key: line.restarts for key, line in lines.items() if line.restarts}
            found["strays"] = {key: line.strays for key, line in lines.items() if line.strays}
            found["heard"] = {
                key: number for key, account in self._accounts.items() if (number := account.heard - account.before)
            }
            return found

    def lost(self) -> dict[str, int]:
        """Samples missing from the file: overflow, unwritten, gaps and malformed together."""
        counts = self.counts()
        total: Counter[str] = Counter()
        for kind in self.LOST:
            total.update(counts[kind])
        return dict(sorted(total.items()))

    def metadata(self) -> Mapping[str, str]:
        """Metadata for the file: a total of each kind, and `<kind> <key>` for each key with such samples."""
        counts = self.counts()
        entries = {f"{kind}_total": str(sum(counts[kind].values())) for kind in self.KINDS}
        for kind in self.KINDS:
            entries.update({f"{kind} {key}": str(number) for key, number in sorted(counts[kind].items())})
        return entries
