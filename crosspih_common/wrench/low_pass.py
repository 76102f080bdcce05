"""A first-order low-pass filter, given by cutoff and sample period, for single samples or batches."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import exp, pi

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array


@dataclass(frozen=True, slots=True)
class LowPass:
    """A first-order low-pass and its state: y += (1 - exp(-2 pi f T)) (x - y), exact for held inputs.

    `last` is the latest output (n,), None before the first sample, which passes unchanged.
    """

    cutoff_hz: float
    period_s: float
    last: tuple[float, ...] | None = None
    gain: float = field(init=False)

    def __post_init__(self) -> None:
        if not self.cutoff_hz > 0.0 or not self.period_s > 0.0:
            raise ValueError(
                f"LowPass wants cutoff_hz > 0 and period_s > 0, got {self.cutoff_hz} Hz and {self.period_s} s"
            )
        object.__setattr__(self, "gain", 1.0 - exp(-2.0 * pi * self.cutoff_hz * self.period_s))

    def at_period(self, period_s: float) -> LowPass:
        """The same filter for samples of another period, s; its memory is kept."""
        return self if period_s == self.period_s else replace(self, period_s=period_s)

    def next(self, last: Array, sample: Array) -> Array:
        """The output after one more sample, both (n,): for a loop that keeps the last output itself."""
        return last + self.gain * (sample - last)

    def filtered(self, samples: ArrayLike) -> tuple[LowPass, Array]:
        """The next state and the filtered samples (m, n) of samples (m, n) in order of time."""
        given = np.atleast_2d(np.asarray(samples, dtype=float))
        if given.shape[0] == 0:
            return self, given
        from scipy.linalg.lapack import dtbtrs  # imported only when batches are filtered

        start = given[0] if self.last is None else np.asarray(self.last)
        rest = 1.0 - self.gain
        # y_i - rest y_(i-1) = gain x_i, all rows at once by substitution. scipy.signal.lfilter gives the same numbers,
        # but loads scipy.stats with it: half a second at the start of every service
        bands = np.empty((2, len(given)))
        bands[0], bands[1] = 1.0, -rest
        right = self.gain * given
        right[0] += rest * start
        output, _ = dtbtrs(bands[: len(given)], right, uplo="L", diag="U")
        return replace(self, last=tuple(output[-1].tolist())), np.asarray(output, dtype=float)
