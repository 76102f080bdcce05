"""A device's own time, mapped to this machine's clock, with an uncertainty that holds.

What a device measured at its own time `d` arrives here at h = T(d) + delay. A delay is never negative, mostly short and
now and then long, so that arrivals lie above a line, T, and touch it: it is their lower envelope (Paxson, "On calibrating
measurements of packet transit times", SIGMETRICS 1998; Moon, Skelly and Towsley, "Estimation and removal of clock skew
from network delay measurements", INFOCOM 1999). One-way times alone cannot tell the shortest delay from an offset of the
clocks. So one thing must be known of the transport, `best_delay_s`: of all that arrives within `span_s` at least one
piece was no longer under way than that. Each span then bounds T from both sides,

    h_best - best_delay_s  <=  T(d_best)  <=  h_best        h_best: the arrival that lies lowest in its span,

pairs of spans bound the rate of the device's clock, and all of them bound T now. The middle of what is left is the
estimate, half of it the uncertainty: a bound, not a standard deviation. It holds as long as

- a span has one arrival within `best_delay_s` (spans that contradict the others are found and struck out),
- the device's clock is wrong by `max_drift_ppm` at the most, and changes its rate by `wander_ppm_s` at the most,
- no delay is longer than `longest_delay_s`. In the first span the uncertainty is that long.

A counter that wraps and a device that was restarted are told apart by the time that went by here meanwhile. A step of the
device's clock shorter than `longest_delay_s` looks like a delay at first, and is noticed after `PATIENCE` spans.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array

REORDERED_S = 0.02  # a piece may overtake another by so much
GAP = 0.25  # of a span, in which nothing came
NOTHING_YET = "nothing of the device was observed yet; observe an arrival before asking for its time"
PATIENCE = 3  # spans in a row that lie too late: not their delays, but the device's clock has changed


class DeviceClock:
    """`observe` each arrival, or some of them; then `to_host_ns` says when the device's time was on this machine's clock.

    `wrap_s` is where the device's counter begins anew, in seconds: 2**32 counts over their rate; None: it never does. Not
    for several threads at once.
    """

    def __init__(
        self, *, wrap_s: float | None = None, best_delay_s: float = 5e-4, longest_delay_s: float = 0.5,
        max_drift_ppm: float = 300.0, wander_ppm_s: float = 0.5, span_s: float = 1.0, spans: int = 16,
    ) -> None:  # fmt: skip
        self._wrap_s, self._best_s, self._longest_s = wrap_s, best_delay_s, longest_delay_s
        self._max_slope, self._wander, self._span_s, self._spans = (
            max_drift_ppm * 1e-6, wander_ppm_s * 1e-6, span_s, spans
        )  # fmt: skip
        self.restarts = 0  # of the device's clock: a restart of the device, or a step of either clock
        self.struck = 0  # spans in which no arrival came within `best_delay_s`
        self._observed = False

    # ------------------------------------------------------------------------------------------------------ observing

    def observe(self, device_s: float, host_ns: int) -> None:
        """Something that the device stamped with its own time arrived here."""
        if not self._observed:
            self._observed = True
            self._start(device_s, host_ns)
            return
        host_s = (host_ns - self._host0_ns) * 1e-9
        elapsed_s = host_s - self._last_host_s
        step_s = device_s - self._last_raw_s
        if self._wrap_s is not None and step_s < -self._longest_s and self._goes_on(step_s + self._wrap_s, elapsed_s):
            step_s += self._wrap_s
        if not self._goes_on(step_s, elapsed_s):
            if not -REORDERED_S < step_s < 0.0:
                self._restart(device_s, host_ns)
            return
        self._last_raw_s, self._last_host_s = device_s, host_s
        x = self._x = self._x + step_s
        e = host_s - x
        if step_s > GAP * self._span_s:  # what came before is not enough of a span
            self._open_span(x)
        if e < self._least_at(x):
            self._earlier_than_possible(x, e, device_s, host_ns)
            return
        lowness = e - self._slope * x
        if lowness < self._lowness:
            self._lowness, self._lowest_x, self._lowest_e = lowness, x, e
            if e < self._most_at(x):
                self._settle(x, None if self._least is None else self._least_at(x), e)
        if x - self._span_x >= self._span_s:
            self._close_span(device_s, host_ns)

    def _goes_on(self, step_s: float, elapsed_s: float) -> bool:
        """Whether the device's time can have gone on by `step_s` while ours did by `elapsed_s`."""
        return step_s >= 0.0 and abs(step_s - elapsed_s) <= self._longest_s + self._max_slope * abs(elapsed_s)

    def _restart(self, device_s: float, host_ns: int) -> None:
        self.restarts += 1
        self._start(device_s, host_ns)

    def _start(self, device_s: float, host_ns: int) -> None:
        """From here on nothing is known but this arrival; x is the device's time since, e what an arrival is above it."""
        self._host0_ns = host_ns
        self._last_raw_s, self._last_host_s, self._x = device_s, 0.0, 0.0
        # of each span the lowest arrival, and by how much it may lie above T: inf where that is not known
        self._xs: list[float] = []
        self._es: list[float] = []
        self._slacks: list[float] = []
        self._slope, self._slope_half, self._slope_x = 0.0, self._max_slope, 0.0
        self._late = 0
        self._open_span(0.0)
        self._lowness = 0.0
        self._settle(0.0, None, 0.0)

    def _open_span(self, x: float) -> None:
        self._span_x, self._lowness = x, math.inf
        self._lowest_x = self._lowest_e = 0.0

    # -------------------------------------------------------------------------------------------------------- fitting

    def _settle(self, x: float, least: float | None, most: float) -> None:
        """T - x lies between these at x; None: nothing is known but the latest arrivals, and the usual delay believed."""
        self._ref_x, self._least, self._most = x, least, most
        if least is None or most - least > self._longest_s:
            self._least = None
            self._mid, self._half = most - 0.5 * self._best_s, self._longest_s
        else:
            self._mid, self._half = 0.5 * (most + least), 0.5 * (most - least)

    def _spread(self, dx: float, before: float) -> float:
        """How far T may have gone from a straight line by dx away from where it was looked at, which was `before` since
        the slope was."""
        return dx * (self._slope_half + self._wander * (before + 0.5 * dx))

    def _spread_at(self, x: float) -> float:
        return self._spread(abs(x - self._ref_x), abs(self._ref_x - self._slope_x))

    def _most_at(self, x: float) -> float:
        return self._most + self._slope * (x - self._ref_x) + self._spread_at(x)

    def _least_at(self, x: float) -> float:
        least = self._most - self._longest_s if self._least is None else self._least
        return least + self._slope * (x - self._ref_x) - self._spread_at(x)

    def _earlier_than_possible(self, x: float, e: float, device_s: float, host_ns: int) -> None:
        """No delay is negative: what said that T lies higher was wrong, or the device's clock has stepped onward."""
        if e < self._least_at(x) - self._longest_s or not self._xs:
            self._restart(device_s, host_ns)
            return
        for k, (x_k, e_k, slack) in enumerate(zip(self._xs, self._es, self._slacks, strict=True)):
            if e_k - slack + self._slope * (x - x_k) - self._spread(x - x_k, 0.0) > e:
                self.struck += 1
                self._slacks[k] = math.inf
        self._slope, self._slope_half, self._slope_x = 0.0, self._max_slope, x
        if not self._bound(x):
            self._restart(device_s, host_ns)
            return
        self._lowness, self._lowest_x, self._lowest_e = e - self._slope * x, x, e
        if e < self._most_at(x):
            self._settle(x, None if self._least is None else min(self._least_at(x), e), e)

    def _close_span(self, device_s: float, host_ns: int) -> None:
        x_k, e_k, x = self._lowest_x, self._lowest_e, self._x
        # the lowest one need not be the one with the shortest delay: the slope by which they are compared is not exact
        slack = self._best_s + self._spread(self._span_s, x - self._slope_x)
        if self._xs and e_k - slack > self._most_at(x_k):
            self.struck += 1
            self._late += 1
            slack = math.inf
        else:
            self._late = 0
        if self._late >= PATIENCE:
            self._restart(device_s, host_ns)
            return
        self._xs.append(x_k)
        self._es.append(e_k)
        self._slacks.append(slack)
        for kept in (self._xs, self._es, self._slacks):
            del kept[: -self._spans]
        self._open_span(x)
        if not self._bound(x):
            self._restart(device_s, host_ns)

    def _bound(self, x: float) -> bool:
        """What all spans say of slope and offset at x; False where they contradict each other."""
        xs, es, slacks = np.array(self._xs), np.array(self._es), np.array(self._slacks)
        half = self._slope_half + self._wander * (x - self._slope_x)
        least_slope, most_slope = max(self._slope - half, -self._max_slope), min(self._slope + half, self._max_slope)
        i, j = np.triu_indices(len(xs), 1)
        apart = xs[j] - xs[i]
        far = apart > GAP * self._span_s
        if far.any():
            i, j, apart = i[far], j[far], apart[far]
            since = self._wander * (x - xs[i])
            most_slope = min(most_slope, float(np.min((es[j] - es[i] + slacks[i]) / apart + since)))
            least_slope = max(least_slope, float(np.max((es[j] - slacks[j] - es[i]) / apart - since)))
        if least_slope > most_slope:
            return False
        self._slope, self._slope_half = 0.5 * (least_slope + most_slope), 0.5 * (most_slope - least_slope)
        self._slope_x = x
        dx = x - xs
        spread = dx * (self._slope_half + 0.5 * self._wander * dx)
        at_x = es + self._slope * dx
        least, most = float(np.max(at_x - slacks - spread)), float(np.min(at_x + spread))
        if least > most:
            return False
        self._settle(x, None if math.isinf(least) else least, most)
        return True

    # ---------------------------------------------------------------------------------------------------------- asking

    @property
    def uncertainty_s(self) -> float:
        """How far `to_host_ns` may be off for what was observed last, either way; inf before anything was."""
        return self._half + self._spread_at(self._x) if self._observed else math.inf

    @property
    def settled(self) -> bool:
        """Whether a first span is over, so that `uncertainty_s` is of the transport and not of its longest delay."""
        return self._observed and bool(self._xs)

    @property
    def drift_ppm(self) -> float:
        """By how much the device's clock is slower than ours."""
        return self._slope * 1e6 if self._observed else 0.0

    @property
    def drift_uncertainty_ppm(self) -> float:
        """How far `drift_ppm` may be off, either way."""
        return (self._slope_half if self._observed else self._max_slope) * 1e6

    def to_host_ns(self, device_s: float) -> int:
        """When it was, on this machine's clock, that the device's own was at `device_s`. Raises ValueError before any
        arrival was observed."""
        if not self._observed:
            raise ValueError(NOTHING_YET)
        step_s = device_s - self._last_raw_s
        if self._wrap_s is not None:
            step_s -= self._wrap_s * round(step_s / self._wrap_s)
        x = self._x + step_s
        return self._host0_ns + round((x + self._mid + self._slope * (x - self._ref_x)) * 1e9)

    def many_to_host_ns(self, device_s: Array) -> NDArray[np.int64]:
        """The same for times (n,) of the device."""
        if not self._observed:
            raise ValueError(NOTHING_YET)
        step_s = np.asarray(device_s, float) - self._last_raw_s
        if self._wrap_s is not None:
            step_s = step_s - self._wrap_s * np.round(step_s / self._wrap_s)
        x = self._x + step_s
        offset = self._mid + self._slope * (x - self._ref_x)
        return np.asarray(self._host0_ns + np.rint((x + offset) * 1e9).astype(np.int64))

    def many_to_device_s(self, host_ns: NDArray[np.int64]) -> Array:
        """The device's time (n,) at times (n,) of this machine's clock: the other way round. Raises ValueError likewise."""
        if not self._observed:
            raise ValueError(NOTHING_YET)
        host_s = (np.asarray(host_ns) - self._host0_ns) * 1e-9
        x = (host_s - self._mid + self._slope * self._ref_x) / (1.0 + self._slope)
        device_s = self._last_raw_s + (x - self._x)
        return np.asarray(device_s if self._wrap_s is None else device_s % self._wrap_s)
