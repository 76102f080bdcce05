"""Where the hole can still be, across its axis: a grid over (x, y, turn), narrowed by each probe.

A probe that meets the face says that the hole is not under the point that touched; one that goes past the face says
that the whole tip fits. Nothing here knows what shape the outline has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.planning.search.face import FaceContact, FacePlane
from services.planning.search.outline_field import OutlineField

SD_M = 3.0e-4  # of a contact point's place across the axis
ON_RIM_SD_M = 6.0e-4
SURPRISE = 0.01  # how likely a contact was not what it seemed
MARGIN_M = 5.0e-4  # by which a probe shall clear the rim
CELLS_ACROSS = 33
TURNS = 7
OFFSET_STEP_M = 5.0e-4
NEGLIGIBLE = 1.0e-3
PLACES = 13


def around_m(corners_m: Array, spacing_m: float = 1.0e-3) -> Array:
    """Points (n, 2) along an outline (m, 2 or more), its corners among them."""
    start = np.asarray(corners_m, float)[:, :2]
    points = []
    for here, there in zip(start, np.roll(start, -1, axis=0), strict=True):
        count = max(1, int(np.ceil(float(np.linalg.norm(there - here)) / spacing_m)))
        points.append(here + (there - here) * (np.arange(count) / count)[:, None])
    return np.concatenate(points)


def _turned(points_m: Array, turns_rad: Array) -> Array:
    """Points (n, 2) turned by each of (k,): (k, n, 2)."""
    cos, sin = np.cos(turns_rad)[:, None], np.sin(turns_rad)[:, None]
    x, y = points_m[..., 0], points_m[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class HoleBelief:
    """Cells (k, 3) of (x, y, turn) in the nominal hole's frame, m and rad, with their weights (k,), which sum to 1."""

    rim: OutlineField
    tip_m: Array
    cells: Array
    weights: Array

    @classmethod
    def uniform(cls, rim_m: Array, tip_m: Array, half_ranges: Array) -> HoleBelief:
        """All places alike. rim_m (m, 2): the opening on the outer face; tip_m (n, 2): the outline of the peg's tip;
        half_ranges (6,) as in the cell's prior."""

        def centres(half: float, count: int) -> Array:
            return (2.0 * np.arange(count) + 1.0 - count) / count * half

        axes = (
            centres(float(half_ranges[0]), CELLS_ACROSS),
            centres(float(half_ranges[1]), CELLS_ACROSS),
            centres(float(half_ranges[5]), TURNS),
        )
        cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        margin = 2.0 * float(np.linalg.norm(half_ranges[:2])) + float(np.linalg.norm(tip_m[:, :2], axis=1).max())
        return cls(OutlineField.of(rim_m, margin), around_m(tip_m), cells, np.full(len(cells), 1.0 / len(cells)))

    def _times(self, likelihood: Array) -> HoleBelief:
        weights = self.weights * (SURPRISE + (1.0 - SURPRISE) * likelihood)
        return HoleBelief(self.rim, self.tip_m, self.cells, weights / weights.sum())

    def _inside_m(self, points_m: Array, cells: Array) -> Array:
        """How far points (k or 1, n, 2) of the nominal hole's frame lie inside each cell's rim: (k, n)."""
        return self.rim.inside_m(_turned(points_m - cells[:, None, :2], -cells[:, 2]))

    def after_face(self, contact: FaceContact) -> HoleBelief:
        """The tip met the face at that point: it is beside the hole, and on its rim where the rim made the contact."""
        inside = self._inside_m(contact.point_m[None, None, :2], self.cells)[:, 0]
        if contact.at_corner:
            return self._times(np.asarray(ndtr(-inside / SD_M)))
        return self._times(np.exp(-0.5 * (inside / ON_RIM_SD_M) ** 2))

    def after_entry(self, tip_in_face_m: Array) -> HoleBelief:
        """All these points (n, 2) of the tip, where it passed the face, are inside the hole's opening."""
        inside = self._inside_m(tip_in_face_m[None], self.cells).min(axis=1)
        return self._times(np.asarray(ndtr(inside / SD_M)))

    def mean(self) -> Array:
        """(3,): x, y in m and turn in rad."""
        return np.asarray(self.weights @ self.cells)

    def covariance(self) -> Array:
        """(3, 3) of (x, y, turn), the cells' own size included."""
        off = self.cells - self.mean()
        own = (np.ptp(self.cells, axis=0) / (np.array([CELLS_ACROSS, CELLS_ACROSS, TURNS]) - 1.0)) ** 2 / 12.0
        return np.asarray((self.weights[:, None] * off).T @ off + np.diag(own))

    def entry_chances(self, places_m: Array, turn_rad: float) -> Array:
        """(p,): how likely the tip, centred at each of (p, 2) and turned so, goes in."""
        half = float(np.abs(places_m).max() + np.abs(self.cells[:, :2]).max()) * 1.5
        chances = np.zeros(len(places_m))
        for turn in np.unique(self.cells[:, 2]):
            these = np.flatnonzero((self.cells[:, 2] == turn) & (self.weights > NEGLIGIBLE * self.weights.max()))
            if len(these) == 0:
                continue
            # the tip as this cell's hole sees it
            section = _turned(self.tip_m, np.array([turn_rad - turn]))[0]
            fits = self.rim.eroded(section, half, OFFSET_STEP_M)
            offsets = places_m[:, None] - self.cells[None, these, :2]
            inside = fits.inside_m(_turned(offsets, np.full(len(offsets), -turn)))
            chances += ndtr((inside - MARGIN_M) / MARGIN_M) @ self.weights[these]
        return chances

    def best_probe(self) -> tuple[Array, float, float]:
        """Where the tip is likeliest to go in: its centre (2,), m, its turn, rad, and the chance.

        Of places equally good the one nearest to the mean is taken, for there the tip is farthest from all walls.
        """
        mean = self.mean()
        low, high = self.cells[:, :2].min(axis=0), self.cells[:, :2].max(axis=0)
        axes = [np.linspace(low[axis], high[axis], PLACES) for axis in (0, 1)]
        places = np.concatenate([np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2), mean[None, :2]])
        chances = self.entry_chances(places, float(mean[2]))
        away = np.linalg.norm(places - mean[:2], axis=1) / float((high - low).max())
        best = int(np.argmax(chances - 0.2 * away))
        return places[best], float(mean[2]), float(chances[best])


def pose_prior(belief: HoleBelief, plane: FacePlane, sd_extra: Array | None = None) -> tuple[Pose, Array]:
    """Mean pose of the hole in the nominal hole's frame, and covariance (6, 6), of the two beliefs together."""
    x, y, turn = belief.mean()
    pose = plane.pose(float(x), float(y), float(turn))
    covariance = np.zeros((6, 6))
    across = belief.covariance()
    covariance[np.ix_((0, 1, 5), (0, 1, 5))] = across
    row = np.array([1.0, x, y])
    # depth and the two tilts follow from the plane; z at other (x, y) is not asked for
    to_pose = np.array([row, [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    covariance[np.ix_((2, 3, 4), (2, 3, 4))] = to_pose @ plane.covariance @ to_pose.T
    if sd_extra is not None:
        covariance += np.diag(np.square(sd_extra))
    return pose, covariance
