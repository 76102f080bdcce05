"""How fast a path may be gone along: as asked, but slowly where the peg may meet the fixture.

The rate of a path's own time, (0, 1], is the allowed speed of the peg's fastest point over the speed it would have.
The allowed speed is the contact speed v_c inside the zone, and sqrt(v_c^2 + 2 a d) at a distance d before it, from
which the arm can slow down to v_c with the deceleration a.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from crosspih_common.geometry.pose import Array

SMOOTH_S = 0.1  # over which a change of the rate is spread


@dataclass(frozen=True, slots=True, eq=False)
class Pace:
    """Rates (k,) at times (k,) of a path, s; linear in between.

    `touching_m_s` (k,) is how fast the peg's fastest point then is where it may touch, 0 where it may not.
    """

    times_s: Array
    rates: Array
    touching_m_s: Array

    @property
    def slows(self) -> bool:
        """Whether any part of the path is gone slower than asked."""
        return bool(np.min(self.rates) < 1.0)

    def samples(self, duration_s: float, period_s: float) -> tuple[Array, Array, Array]:
        """Times of the path (n,), s, a cycle apart, the last one its end; rates and touching speeds (n,) there."""
        if not self.slows:
            count = max(1, int(np.ceil(duration_s / period_s - 1e-9)))
            at = np.minimum(np.arange(1, count + 1) * period_s, duration_s)
            return at, np.ones(count), np.interp(at, self.times_s, self.touching_m_s)
        at, rates = self._smooth(duration_s, period_s)
        return at, rates, np.interp(at, self.times_s, self.touching_m_s)

    def _smooth(self, duration_s: float, period_s: float) -> tuple[Array, Array]:
        """Times and rates (n,), the rates' steps and corners rounded: what is felt at the wrist is acceleration.

        The least rate of a window, averaged twice over half of it, is never above the rate in the window's middle.
        Going slower earlier the arm comes later to where it has to be slow, never sooner.
        """
        gone = np.concatenate(
            [[0.0], np.cumsum(np.diff(self.times_s) * 0.5 * (1.0 / self.rates[1:] + 1.0 / self.rates[:-1]))]
        )
        count = max(1, int(np.ceil(gone[-1] / period_s)))
        rates = np.interp(np.interp(np.arange(count) * period_s, gone, self.times_s), self.times_s, self.rates)
        half = max(1, int(0.5 * SMOOTH_S / period_s))
        rates = minimum_filter1d(rates, 2 * half + 1, mode="nearest")
        for _ in range(2):
            rates = uniform_filter1d(rates, half, mode="nearest")
        short_s = duration_s - float(rates.sum()) * period_s
        if short_s > 0.0:
            rates = np.append(rates, np.full(int(np.ceil(short_s / period_s / rates[-1])), rates[-1]))
        at = np.minimum(np.cumsum(rates) * period_s, duration_s)
        last = int(np.argmax(at >= duration_s - 1e-12))
        at, rates = at[: last + 1], rates[: last + 1]
        at[-1] = duration_s
        return at, rates


def slowed(times_s: Array, point_speeds_m_s: Array, allowed_m_s: Array, may_touch: NDArray[np.bool_]) -> Pace:
    """The pace that keeps the fastest point's speed (k,) at times (k,) below what is allowed there (k,), m/s."""
    # the least of a node and its neighbours: between two nodes as well nothing is faster than it may be
    rates = minimum_filter1d(np.minimum(1.0, allowed_m_s / np.maximum(point_speeds_m_s, 1e-12)), 3, mode="nearest")
    return Pace(times_s, rates, np.where(may_touch, rates * point_speeds_m_s, 0.0))
