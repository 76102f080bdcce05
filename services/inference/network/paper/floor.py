"""The floor of the network's error: the best that any regressor from one wrench to the angles can reach.

One contact's wrench has few degrees of freedom. With enough samples its nearest neighbours represent the angles'
whole conditional distribution, and their mean is the best guess in the mean square (the regression function; Stone
1977). The remaining error is information that the wrench does not carry.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from crosspih_common.geometry.pose import Array

# distances between neighbours are in units of the sensor's resolution
FORCE_SCALE_N, MOMENT_SCALE_NM = 0.2, 0.01


def nearest_neighbours(
    known_wrench: Array, known_angles_rad: Array, wrench: Array, neighbours: int = 32
) -> tuple[Array, Array]:
    """The mean angles (m, 3) of the nearest known contacts of each wrench (m, 6), and the number of neighbours used.

    known_wrench (n, 6), known_angles_rad (n, 3). With fewer than 20 known contacts per neighbour, fewer neighbours are
    used. Raises ValueError without known contacts.
    """
    if len(known_wrench) == 0:
        raise ValueError("nearest_neighbours wants at least one known contact")
    count = int(np.clip(len(known_wrench) // 20, 1, neighbours))
    scale = np.repeat([FORCE_SCALE_N, MOMENT_SCALE_NM], 3)
    _, found = cKDTree(known_wrench / scale).query(wrench / scale, k=count)
    return known_angles_rad[np.reshape(found, (len(wrench), count))].mean(axis=1), np.asarray(count)


def floor_rms_rad(
    known_wrench: Array, known_angles_rad: Array, wrench: Array, angles_rad: Array, neighbours: int = 32
) -> Array:
    """RMS (3,) of the best guess from the wrench, rad; the sampling error of the neighbours' mean is subtracted."""
    guess, count = nearest_neighbours(known_wrench, known_angles_rad, wrench, neighbours)
    rms = np.sqrt(np.mean((guess - angles_rad) ** 2, axis=0))
    return np.asarray(rms / np.sqrt(1.0 + 1.0 / float(count)))
