"""Fewer points of a curve, such that it looks the same and keeps every peak. Pure."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array

BUCKETS = 420
MOST_WHOLE = 5000


def thinned(columns: Array, interest: Array | None = None, buckets: int = BUCKETS) -> NDArray[np.int64]:
    """Which rows (k,) of columns (n, m), sampled in order of time, are worth drawing.

    In each of `buckets` pieces of equal length the rows at which any column is lowest and highest are kept, so the
    peaks of all columns are. Of the rows whose `interest` (n,) is above 0 the most interesting are kept too, up to
    `MOST_WHOLE`: there zooming in shows each sample.
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
