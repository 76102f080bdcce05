"""The statistics of a LeRobot dataset: each feature's smallest, largest, mean, deviation and quantiles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
Statistics = dict[str, NDArray[np.float64]]


def of_rows(rows: NDArray[np.generic]) -> Statistics:
    """The statistics of (n,) or (n, k): arrays of 1 or k numbers, and the count."""
    values = np.asarray(rows, float).reshape(len(rows), -1)
    found = {
        "min": values.min(axis=0), "max": values.max(axis=0), "mean": values.mean(axis=0), "std": values.std(axis=0),
        "count": np.array([len(values)], float),
    }  # fmt: skip
    return found | {name: np.quantile(values, share, axis=0) for name, share in QUANTILES.items()}


def of_pictures(pictures: list[NDArray[np.uint8]], numbers: NDArray[np.int64]) -> Statistics:
    """The statistics of the pictures' channels, 0 to 1, each picture counted as often as it is shown:
    arrays (3, 1, 1).
    """
    weights = np.bincount(numbers[numbers >= 0], minlength=len(pictures)) if (numbers >= 0).any() else None
    used = [index for index in range(len(pictures)) if weights is None or weights[index]]
    values = np.concatenate([pictures[index][::4, ::4].reshape(-1, 3) for index in used]) / 255.0
    found = of_rows(values)
    shaped = {name: one.reshape(3, 1, 1) for name, one in found.items() if name != "count"}
    return shaped | {"count": np.array([len(numbers)], float)}
