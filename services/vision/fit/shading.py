"""The prior of the chamfers' brightness by the direction they face.

Light from large or distant sources falls on a surface nearly as a linear function of its normal (spherical harmonics of
a clamped cosine: Ramamoorthi and Hanrahan 2001). So two opposite chamfers are together about as bright as any other two
opposite ones, however bright each is.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.rim import Rim

# deviation from that rule for glossy paint, metal and small lamps: one sd, times the face's grey
UNEVEN_SHADE = 0.1


def shade_belief(rim: Rim) -> Array:
    """(F, F): inverse variance of the chamfers' greys over the face's, by facing: zero for the constant and linear
    parts, UNEVEN_SHADE for the rest. Zero where too few directions determine a rest."""
    first = np.unique(rim.facing, return_index=True)[1]
    present = rim.facing[first]
    belief = np.zeros((int(present[-1]) + 1,) * 2)
    belief[present[:, None], present] = _belief_of(rim.outward[first].mean(axis=1)[:, :2].tobytes())
    return belief


@lru_cache(maxsize=32)
def _belief_of(directions: bytes) -> Array:
    ways = np.frombuffer(directions).reshape(-1, 2)
    linear = np.column_stack([np.ones(len(ways)), ways])
    return np.asarray(np.eye(len(ways)) - linear @ np.linalg.pinv(linear)) / UNEVEN_SHADE**2
