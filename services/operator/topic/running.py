"""Statistics of samples as they come, over the newest ones: rate, delay, size. Pure."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean, standard deviation (of the population), least and largest of `count` values."""

    count: int
    mean: float
    sd: float
    least: float
    largest: float

    def shifted(self, by: float) -> Spread:
        """The spread of the same values, each larger by this amount."""
        return Spread(self.count, self.mean + by, self.sd, self.least + by, self.largest + by)


class Newest:
    """The newest `window` values."""

    def __init__(self, window: int) -> None:
        self._values: deque[float] = deque(maxlen=window)

    def add(self, value: float) -> None:
        """Add a value; the oldest is dropped when the window is full."""
        self._values.append(value)

    def spread(self) -> Spread | None:
        """The spread of the kept values; None where there is none. O(window), for use once a second."""
        if not self._values:
            return None
        count, mean = len(self._values), math.fsum(self._values) / len(self._values)
        variance = math.fsum((value - mean) ** 2 for value in self._values) / count
        return Spread(count, mean, math.sqrt(variance), min(self._values), max(self._values))

    def total(self) -> float:
        """Their sum."""
        return math.fsum(self._values)


class Arrivals:
    """The times of samples, s on any clock that runs evenly, their sizes, and how many numbers are
    missing among them.
    """

    def __init__(self, window: int) -> None:
        self._intervals, self._sizes = Newest(window), Newest(window)
        self._last_s: float | None = None
        self._last_number = -1
        self.count = 0
        self.missing = 0

    def add(self, at_s: float, size_bytes: int, number: int) -> None:
        """Add a sample. `number`: the publisher's count of it, -1 where it sends none. A count that begins anew, as
        that of a restarted service does, means no missing sample.
        """
        if self._last_s is not None:
            self._intervals.add(at_s - self._last_s)
            self._sizes.add(float(size_bytes))
        if self._last_number >= 0 and number > self._last_number + 1:
            self.missing += number - self._last_number - 1
        self._last_s, self._last_number = at_s, number
        self.count += 1

    def intervals(self) -> Spread | None:
        """Between one sample and the next, s; None before the second."""
        return self._intervals.spread()

    def sizes(self) -> Spread | None:
        """Bytes of a sample; None before the second."""
        return self._sizes.spread()

    def rate_hz(self) -> float | None:
        """Samples a second; None before the second sample, or where all came at once."""
        spent_s = self._intervals.total()
        found = self._intervals.spread()
        return None if found is None or spent_s <= 0.0 else found.count / spent_s

    def bytes_a_second(self) -> float | None:
        """Of payload alone, as `rate_hz`."""
        spent_s = self._intervals.total()
        return None if spent_s <= 0.0 else self._sizes.total() / spent_s


class CellTimeOffset:
    """How far the cell's time is ahead of a local clock, estimated from the ticks of the cell's clock.

    A tick that travelled long came late, so the fastest tick counts. A delay computed with it leaves out the time that
    the fastest tick itself needed. Ticks of another run of the cell start the estimate anew.
    """

    def __init__(self) -> None:
        self.offset_s: float | None = None  # the cell's time minus the local one; None before the first tick
        self._boot_id = ""

    def tick(self, stamp_s: float, at_s: float, boot_id: str) -> None:
        """A tick with this stamp came at `at_s` here."""
        if boot_id != self._boot_id:
            self._boot_id, self.offset_s = boot_id, None
        offset_s = stamp_s - at_s
        self.offset_s = offset_s if self.offset_s is None else max(self.offset_s, offset_s)
