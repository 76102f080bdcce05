"""Growing rows, and few points that show what many do."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from services.viewer.series import GrowingRows, decimated


@given(st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=400), st.integers(1, 30))
def test_few_points_reach_every_extreme_and_span_the_same_time(values: list[float], buckets: int) -> None:
    times = np.arange(len(values), dtype=float)
    column = np.array(values)[:, None]
    at, shown = decimated(times, np.hstack([column, -column]), buckets)
    assert len(at) <= max(2 * buckets, 0) or len(at) == len(times)
    assert np.all(np.diff(at) >= 0.0) and (at[0], at[-1]) == (times[0], times[-1])
    assert (shown[:, 0].min(), shown[:, 0].max()) == (min(values), max(values))
    assert shown[:, 1].max() == -min(values)


@given(st.lists(st.integers(0, 50), min_size=1, max_size=3000), st.integers(-1, 60))
def test_the_row_of_a_moment_is_the_newest_that_was_there(stamps: list[int], moment: int) -> None:
    rows = GrowingRows(1)
    kept: list[tuple[int, int]] = []
    for index, stamp in enumerate(stamps):
        rows.append(stamp, [index])
        if not kept or stamp >= kept[-1][0]:
            kept.append((stamp, index))
    before = [index for stamp, index in kept if stamp <= moment]
    found = rows.at(moment)
    assert (None if found is None else found[0]) == (before[-1] if before else None)
    inside = [index for stamp, index in kept if 10 <= stamp <= 20]
    assert rows.between(10, 20)[1].ravel().tolist() == inside
    rows.forget_before(moment)
    assert rows.stamps_ns.tolist() == [stamp for stamp, _ in kept if stamp >= moment]
