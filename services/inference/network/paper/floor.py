"""How good any regressor from one wrench to the angles can be: the floor under the network.

One contact's wrench has few degrees of freedom, so that with samples enough its nearest neighbours have the angles'
whole conditional distribution, and their mean is the best guess in the mean square (the regression function; Stone
1977). What is left is what the wrench does not say.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from crosspih_common.geometry.pose import Array

# neighbours are near in units of what a sensor tells apart
FORCE_SCALE_N, MOMENT_SCALE_NM = 0.2, 0.01


def nearest_neighbours(
    known_wrench: Array, known_angles_rad: Array, wrench: Array, neighbours: int = 32
) -> tuple[Array, Array]:
    """The mean angles (m, 3) of the nearest known contacts of each wrench (m, 6), and how many neighbours it took.

    known_wrench (n, 6), known_angles_rad (n, 3). With fewer than 20 known contacts a neighbour, fewer neighbours.
    ValueError without known contacts.
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
    """RMS (3,) of the best guess from the wrench, rad; the spread of the neighbours' own mean is taken out."""
    guess, count = nearest_neighbours(known_wrench, known_angles_rad, wrench, neighbours)
    rms = np.sqrt(np.mean((guess - angles_rad) ** 2, axis=0))
    return np.asarray(rms / np.sqrt(1.0 + 1.0 / float(count)))
