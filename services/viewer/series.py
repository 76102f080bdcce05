"""Growing series of numbers, and their reduction to a chart of few points without losing a peak."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crosspih_common.geometry.pose import Array

FIRST_ROWS = 1024


class GrowingRows:
    """Stamps (n,), ns, in ascending order, with a row of `width` numbers each; appended in amortised constant time."""

    def __init__(self, width: int) -> None:
        self._stamps = np.zeros(FIRST_ROWS, np.int64)
        self._values = np.zeros((FIRST_ROWS, width))
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(n,)."""
        return self._stamps[: self._count]

    @property
    def values(self) -> Array:
        """(n, width)."""
        return self._values[: self._count]

    def append(self, stamp_ns: int, row: ArrayLike) -> None:
        """Append a row; one that is older than the newest is dropped, as a sample that was overtaken."""
        if self._count and stamp_ns < self._stamps[self._count - 1]:
            return
        if self._count == len(self._stamps):
            self._stamps = np.concatenate([self._stamps, np.zeros_like(self._stamps)])
            self._values = np.concatenate([self._values, np.zeros_like(self._values)])
        self._stamps[self._count] = stamp_ns
        self._values[self._count] = row
        self._count += 1

    def forget_before(self, stamp_ns: int) -> None:
        """Remove the older rows."""
        first = int(np.searchsorted(self.stamps_ns, stamp_ns))
        if first:
            kept = self._count - first
            self._stamps[:kept] = self._stamps[first : self._count].copy()
            self._values[:kept] = self._values[first : self._count].copy()
            self._count = kept

    def at(self, stamp_ns: int) -> Array | None:
        """The row (width,) that was the newest at that time; None before the first."""
        index = int(np.searchsorted(self.stamps_ns, stamp_ns, side="right")) - 1
        return None if index < 0 else self.values[index]

    def between(self, first_ns: int, last_ns: int) -> tuple[NDArray[np.int64], Array]:
        """Stamps (k,) and rows (k, width) of a time span, both ends included."""
        low = int(np.searchsorted(self.stamps_ns, first_ns))
        high = int(np.searchsorted(self.stamps_ns, last_ns, side="right"))
        return self.stamps_ns[low:high], self.values[low:high]


def decimated(times: Array, values: Array, buckets: int) -> tuple[Array, Array]:
    """At most 2 x `buckets` points (m,), (m, width) of times (n,) and values (n, width).

    Each bucket of equal duration gives the least and the largest value of every column, ordered as in the column with
    the largest range. A line through them looks like one through all points, and reaches every extreme.
    """
    if len(times) <= 2 * buckets:
        return times, values
    start, span = times[0], max(float(times[-1] - times[0]), 1e-9)
    bucket = np.minimum(((times - start) / span * buckets).astype(np.int64), buckets - 1)
    firsts = np.flatnonzero(np.diff(bucket, prepend=-1))
    lasts = np.append(firsts[1:], len(times)) - 1
    low = np.minimum.reduceat(values, firsts, axis=0)
    high = np.maximum.reduceat(values, firsts, axis=0)
    falls = values[firsts] > values[lasts]
    before, after = np.where(falls, high, low), np.where(falls, low, high)
    at = np.stack([times[firsts], np.maximum(times[lasts], times[firsts])], axis=1).ravel()
    return at, np.stack([before, after], axis=1).reshape(-1, values.shape[1])
