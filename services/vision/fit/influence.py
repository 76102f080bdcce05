"""The influence of each edge on the pose: an edge that disagrees with the others pulls the pose with it.

The delete-one jackknife (Quenouille 1956, Tukey 1958; Efron and Stein 1981) over the edges of both pictures. A cable
along an edge looks like the rim a little aside, and a glint moves one line. The fit treats such an edge as a random
error; the change of the pose without it shows its true effect.
"""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.rim import Rim
from services.vision.fit.solve import POSE, TWICE, Fit, parameters


def without_each(fit: Fit, rim: Rim) -> Array:
    """(2, G, 6): the change of the pose without each edge of each picture: x, y, z, rx, ry, rz of the hole's frame, m
    and rad. One step of the fit from its end, with its weights kept."""
    index = parameters(rim)[0]
    local, pull = fit.local[..., TWICE, :][..., TWICE], fit.gradient[..., TWICE]
    # (A - E L E^T) x' = A x - E b with A^-1 the covariance and E the edge's own parameters: Woodbury's identity
    own = fit.covariance[index[..., :, None], index[..., None, :]]
    rest = local @ fit.effects[index][..., None] - pull[..., None]
    taken = np.linalg.solve(np.eye(len(TWICE)) - local @ own, rest)
    return np.asarray((np.moveaxis(fit.covariance[:POSE, index], 0, 2) @ taken)[..., 0])


def jackknife(fit: Fit, rim: Rim) -> Array:
    """(6, 6), m and rad: the covariance of the pose from the disagreement of its edges."""
    moved = without_each(fit, rim).reshape(-1, POSE)
    return np.asarray((1.0 - 1.0 / len(moved)) * moved.T @ moved)
