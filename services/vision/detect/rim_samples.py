"""Evenly spaced points along the rim of any outline, for the search in a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.rim import Rimmed

SMOOTH_RAD = 0.35  # corners that turn by less are facets of a smooth curve
MAX_SKIP = 0.25  # of a short section: its middle is always sampled


@dataclass(frozen=True, slots=True, eq=False)
class RimSamples:
    """Points on the rim in the hole frame, m: `outer_m` and `inner_m` (M, 3), opposite each other across the chamfer;
    `along` (M, 3) the rim's direction there; `smooth` (M, M) averages each point with its neighbours of the same
    section (rows add up to 1); `round` is true if a turn about the axis changes nothing."""

    outer_m: Array
    inner_m: Array
    along: Array
    smooth: Array
    round: bool

    @classmethod
    def of(cls, hole: Rimmed, count: int, skip_m: float) -> RimSamples:
        """`count` samples, evenly along the rim except for `skip_m` on both sides of each corner, m."""
        outer, inner = hole.outer_rim_m(), hole.inner_rim_m()
        run = np.roll(inner, -1, axis=0) - inner
        length = np.linalg.norm(run, axis=1)
        along = run / length[:, None]
        cosine = np.clip(np.sum(along * np.roll(along, 1, axis=0), axis=1), -1.0, 1.0)
        corner = np.arccos(cosine) > SMOOTH_RAD  # at the start of each edge
        section = np.cumsum(corner) - 1
        section[section < 0] = section[-1]  # the outline starts amid a smooth section
        skip = np.minimum(skip_m, MAX_SKIP * length)
        first = np.where(corner, skip, 0.0)
        last = length - np.where(np.roll(corner, -1), skip, 0.0)
        ends = np.cumsum(last - first)
        at = (np.arange(count) + 0.5) * ends[-1] / count
        edge = np.minimum(np.searchsorted(ends, at), len(inner) - 1)
        reach = first[edge] + at - (ends - (last - first))[edge]
        outward = np.column_stack([along[:, 1], -along[:, 0], np.zeros(len(along))])
        across = np.abs(np.sum((outer - inner) * outward, axis=1))[:, None] * outward
        across[:, 2] = outer[:, 2] - inner[:, 2]
        points = inner[edge] + reach[:, None] * along[edge]
        away = np.hypot(*inner[:, :2].T)
        return cls(
            points + across[edge],
            points,
            along[edge],
            _neighbours(section[edge]),
            not corner.any() and float(np.ptp(away)) < 1e-3 * float(away.mean()),
        )

    def at(self, share: float) -> Array:
        """(M, 3): the points at a share of the way across the chamfer, 0 outside, 1 inside."""
        return self.outer_m + share * (self.inner_m - self.outer_m)


def _neighbours(section: Array) -> Array:
    count = len(section)
    weight = np.eye(count) * 2.0
    for step in (-1, 1):
        other = (np.arange(count) + step) % count
        weight[np.arange(count), other] += section == section[other]
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))
