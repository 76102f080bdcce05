"""Reduces a curve to fewer points that look the same and keep every peak. Pure."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array

BUCKETS = 420
MOST_WHOLE = 5000


def thinned(columns: Array, interest: Array | None = None, buckets: int = BUCKETS) -> NDArray[np.int64]:
    """The rows (k,) of columns (n, m), sampled in order of time, to draw.

    In each of `buckets` pieces of equal length the rows with the lowest and the highest value of any column are kept,
    and so all columns' peaks. Of the rows whose `interest` (n,) is above 0, those of most interest are kept too, up to
    `MOST_WHOLE`: zooming in there shows each sample.
    """
    count = len(columns)
    if count <= 4 * buckets:
        return np.arange(count)
    keep = {0, count - 1}
    edges = np.linspace(0, count, buckets + 1).astype(int)
    for start, end in pairwise(edges):
        piece = columns[start:end]
        keep.update((start + piece.argmin(axis=0)).tolist())
        keep.update((start + piece.argmax(axis=0)).tolist())
    if interest is not None:
        wanted = np.flatnonzero(interest > 0.0)
        if len(wanted) > MOST_WHOLE:
            wanted = wanted[np.argsort(interest[wanted], kind="stable")[-MOST_WHOLE:]]
        keep.update(wanted.tolist())
    return np.array(sorted(keep), dtype=np.int64)
