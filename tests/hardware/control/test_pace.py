"""The pace of a path near the fixture: never faster than allowed, to the end, and without a jerk."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from services.hardware.control.pace import slowed


@settings(max_examples=60, deadline=None)
@given(st.floats(0.005, 0.05), st.floats(0.05, 0.5), st.floats(0.05, 0.4), st.sampled_from([0.001, 0.002, 0.008]))
def test_it_slows_down_in_time_and_comes_to_the_end(
    touching_m_s: float, speed_m_s: float, way_m: float, period_s: float
) -> None:
    """Straight towards a zone that begins at two thirds of the way, at one speed, which the zone does not allow."""
    duration_s = way_m / speed_m_s
    times = np.linspace(0.0, duration_s, 301)
    before_m = np.maximum(0.0, 2.0 / 3.0 * way_m - speed_m_s * times)
    allowed = np.sqrt(touching_m_s**2 + 2.0 * before_m)
    pace = slowed(times, np.full(301, speed_m_s), allowed, before_m <= 0.0)
    at, rates, touching = pace.samples(duration_s, period_s)
    assert at[-1] == duration_s and np.all(np.diff(at) >= 0.0)
    where_m = speed_m_s * at
    gone_m = np.maximum(0.0, 2.0 / 3.0 * way_m - where_m)
    # between two nodes the square root is a chord, which lies below it; a cycle's step is the rest
    assert np.all(speed_m_s * rates <= 1.02 * np.sqrt(touching_m_s**2 + 2.0 * gone_m) + 2.0 * period_s)
    assert np.all(touching[gone_m > way_m / 100.0] <= touching_m_s + 1e-9)
    steps = np.diff(speed_m_s * rates) / period_s
    assert len(steps) < 2 or np.max(np.abs(steps)) < 1.5 + speed_m_s / 0.05


def test_what_needs_no_slowing_is_left_as_it_is() -> None:
    nothing = slowed(np.array([0.0, 0.0105]), np.ones(2), np.full(2, 5.0), np.zeros(2, dtype=bool))
    at, rates, touching = nothing.samples(0.0105, 0.001)
    assert len(at) == 11 and at[-1] == 0.0105 and np.all(rates == 1.0) and np.all(touching == 0.0)
