"""The mean of samples at rest, and how well it is known."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array


def mean_and_sd(samples: Array) -> tuple[Array, Array]:
    """Mean (6,) of samples (n, 6) in order of time, and the standard deviation (6,) of that mean.

    A sample equal to the one before it in all channels is a repeated reading (the sensor is read more often than it
    measures) and counts once. The deviation of a single sample is unknown: zeros.
    """
    given = np.asarray(samples, dtype=float)
    own = np.concatenate([[True], np.any(given[1:] != given[:-1], axis=1)])
    distinct = given[own]
    count = len(distinct)
    sd = distinct.std(axis=0, ddof=1) / np.sqrt(count) if count > 1 else np.zeros(given.shape[1])
    return np.asarray(distinct.mean(axis=0), dtype=float), np.asarray(sd, dtype=float)
