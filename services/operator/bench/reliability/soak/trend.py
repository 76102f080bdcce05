"""Whether a repeatedly measured figure grows. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WARM_UP_SHARE = 0.2  # the first share of the figures: what is loaded and allocated once is no leak
MIN_FIGURES = 6  # with fewer figures no trend can be computed


@dataclass(frozen=True, slots=True)
class Growth:
    """From the first figure after the warm-up to the last: the growth, and its 95 % interval."""

    first: float
    last: float
    grown: float
    low: float
    high: float

    def is_more_than(self, allowed: float) -> bool:
        """Whether it certainly grew by more than is allowed: the whole interval is above."""
        return self.low > allowed


def growth(at_s: Sequence[float], figures: Sequence[float], warm_up: float = WARM_UP_SHARE) -> Growth | None:
    """Theil and Sen's slope, which single outliers do not change, times the duration; None for too few figures.

    `at_s` and `figures` (n,), in any unit of the latter; `warm_up` is the share of them that is left out at the
    beginning. Source: Sen, J. Am. Stat. Assoc. 63 (1968) 1379.
    """
    from scipy.stats import theilslopes  # imported where it is used: it takes half a second

    skipped = int(len(figures) * warm_up)
    times, values = np.asarray(at_s, float)[skipped:], np.asarray(figures, float)[skipped:]
    if len(values) < MIN_FIGURES or np.ptp(times) <= 0.0:
        return None
    found = theilslopes(values, times, 0.95)
    span_s = float(np.ptp(times))
    slope, low, high = float(found.slope), float(found.low_slope), float(found.high_slope)
    return Growth(float(values[0]), float(values[-1]), slope * span_s, low * span_s, high * span_s)
