"""A closed contour, and the polygon that a peg gets from it: the same one however the contour was drawn.

The result does not depend on the segments in the file. Corners, straight sides, symmetry and roundness are found on the
contour itself. Between corners and straight sides it is divided into chords by arc length. For a rotationally symmetric
contour one sector is divided, and copied by rotation about the axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from shapely import LinearRing, Polygon
from shapely import points as shapely_points
from shapely.validation import explain_validity

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.drawn.curves import FINE_M, DrawingRefused
from crosspih_common.shapes.outline import ROUND_FROM, ROUND_M

CHORD_SHARE = 0.4  # a side that would be off an arc by less than this share of the tolerance is a chord of a curve
MIN_TURN_RAD = np.deg2rad(12.0)
MIN_CORNER_M = 2e-5
MIN_SIDE_M = 1e-3
ALONE = 4.0
ROUND_CHORDS = (32, 64)
SAME_M = 1e-5
SAMPLES = 360
MAX_ORDER = 64
MAX_ANCHORS = 2000


@dataclass(frozen=True, slots=True)
class _Turns:
    """The turning angle of each vertex, rad; for each side from vertex i to i + 1, m, its length and its distance to an
    arc of which it would be a chord."""

    turn_rad: Array
    side_m: Array
    sagitta_m: Array


@dataclass(frozen=True, eq=False)
class Contour:
    """A simple closed contour: `points_m` (n, 2), counter-clockwise, about the centroid of its area; `centroid_m` (2,)
    where that is in the drawing."""

    points_m: Array
    centroid_m: Array

    @cached_property
    def area_m2(self) -> float:
        """What it encloses."""
        return float(Polygon(self.points_m).area)

    @property
    def width_m(self) -> float:
        """Its size along x."""
        return float(np.ptp(self.points_m[:, 0]))

    @property
    def height_m(self) -> float:
        """Its size along y."""
        return float(np.ptp(self.points_m[:, 1]))

    @cached_property
    def corners(self) -> int:
        """How many corners it has; chords of a curve have none between them."""
        if self.symmetry == 0:
            return 0
        turns = self._turns
        turn, side = np.abs(turns.turn_rad), turns.side_m
        off = np.minimum(side, np.roll(side, 1)) / 2.0 * np.tan(turn / 4.0)
        beside = 3.0 * np.maximum(np.roll(turn, 1), np.roll(turn, -1))
        sharp = (off > MIN_CORNER_M) | ((turn > 2.0 * MIN_TURN_RAD) & (turn > beside))
        return int(np.count_nonzero(sharp & (turn >= MIN_TURN_RAD)))

    @cached_property
    def round_radius_m(self) -> float | None:
        """The radius, m, of a contour that is a circle within the chords' tolerance; None if it is no circle."""
        farthest = float(np.max(np.hypot(*self.points_m.T)))
        nearest = float(LinearRing(self.points_m).distance(shapely_points(0.0, 0.0)))
        return farthest if farthest - nearest <= ROUND_M else None

    @cached_property
    def symmetry(self) -> int:
        """The number of rotations about its centroid that map it onto itself; 0 for a circle."""
        if self.round_radius_m is not None:
            return 0
        if len(self._anchors(ROUND_M)) > MAX_ANCHORS:
            return 1
        ring = LinearRing(self.points_m)
        curved = np.logical_not(self._straight(ROUND_M))
        chords_m = float(np.max(self._turns.sagitta_m[curved], initial=0.0))
        starts = self._at(np.linspace(0.0, self._length_m, SAMPLES, endpoint=False))
        samples = np.vstack([starts, self.points_m[self._anchors(ROUND_M)]])
        for order in range(MAX_ORDER, 1, -1):
            turned = samples @ _turn(2.0 * np.pi / order).T
            if float(np.max(ring.distance(shapely_points(turned)))) <= SAME_M + 2.0 * chords_m:
                return 0 if order >= ROUND_FROM else order
        return 1

    def chords(self, tolerance_m: float) -> Array:
        """The corners (k, 2) of a polygon with its corners on the contour, its sides no farther off it than a
        tolerance (m)."""
        if self.round_radius_m is not None:
            return _round(self.round_radius_m, tolerance_m)
        anchors = self._anchors(tolerance_m)
        if len(anchors) > MAX_ANCHORS:
            return np.asarray(self.points_m[anchors])
        places = self._places[anchors] if len(anchors) else self._places[:-1]
        start = float(places[self._farthest(anchors if len(anchors) else np.arange(len(self.points_m)))])
        order = max(self.symmetry, 1)
        span = self._length_m / order
        inside = np.sort((self._places[anchors] - start) % self._length_m)
        margin = 1e-7 if order == 1 else ROUND_M
        inside = inside[(inside > margin) & (inside < span - margin)]
        stops = [0.0, *inside.tolist(), span]
        cut: list[float] = []
        for first, last in pairwise(stops):
            cut += self._cut(start + first, start + last, tolerance_m)
        sector = self._at(np.array(cut))
        return np.vstack([sector @ _turn(2.0 * np.pi * index / order).T for index in range(order)])

    def _cut(self, first: float, last: float, tolerance_m: float, depth: int = 12) -> list[float]:
        """Where chords begin, by the length along the contour, m; a stretch is halved as long as its chord is off."""
        ends = self._at(np.array([first, last]))
        between = self._between(first, last)
        chord = ends[1] - ends[0]
        length = float(np.hypot(*chord))
        if len(between) and depth:
            way = between - ends[0]
            along = np.clip(way @ chord / length**2, 0.0, 1.0) if length > FINE_M else np.zeros(len(way))
            off = float(np.max(np.hypot(*(way - along[:, None] * chord).T)))
            if off > tolerance_m:
                middle = (first + last) / 2.0
                return [
                    *self._cut(first, middle, tolerance_m, depth - 1),
                    *self._cut(middle, last, tolerance_m, depth - 1),
                ]
        return [first]

    def _between(self, first: float, last: float) -> Array:
        """The contour's own points between two lengths along it, the second no more than a turn beyond."""
        low, high = np.searchsorted(self._places, [first, last])
        if last <= self._length_m:
            return self.points_m[low:high]
        wrapped = np.searchsorted(self._places, last - self._length_m)
        if first >= self._length_m:
            return self.points_m[np.searchsorted(self._places, first - self._length_m) : wrapped]
        return np.vstack([self.points_m[low:], self.points_m[:wrapped]])

    def _farthest(self, among: NDArray[np.intp]) -> int:
        """Which of some points is farthest from the centroid; of equals the first counter-clockwise from +x."""
        points = self.points_m[among]
        radii = np.hypot(*points.T)
        angles = np.arctan2(points[:, 1], points[:, 0]) % (2.0 * np.pi)
        angles = np.where(angles > 2.0 * np.pi - 1e-3, 0.0, angles)
        return int(np.argmin(np.where(radii > np.max(radii) - SAME_M, angles, np.inf)))

    @cached_property
    def _places(self) -> Array:
        """(n + 1,): the length along the contour, m, at each point and back at the first."""
        sides = np.roll(self.points_m, -1, axis=0) - self.points_m
        return np.concatenate([[0.0], np.cumsum(np.hypot(*sides.T))])

    @property
    def _length_m(self) -> float:
        return float(self._places[-1])

    def _at(self, places: Array) -> Array:
        """The points (m, 2) at lengths along the contour (m,)."""
        closed = np.vstack([self.points_m, self.points_m[:1]])
        wrapped = np.asarray(places) % self._length_m
        return np.column_stack([np.interp(wrapped, self._places, closed[:, axis]) for axis in (0, 1)])

    @cached_property
    def _turns(self) -> _Turns:
        sides = np.roll(self.points_m, -1, axis=0) - self.points_m
        before = np.roll(sides, 1, axis=0)
        cross = before[:, 0] * sides[:, 1] - before[:, 1] * sides[:, 0]
        turn = np.arctan2(cross, np.sum(before * sides, axis=1))
        length = np.hypot(*sides.T)
        least = np.minimum(np.abs(turn), np.abs(np.roll(turn, -1)))
        return _Turns(turn, length, length / 2.0 * np.tan(least / 4.0))

    def _straight(self, tolerance_m: float) -> NDArray[np.bool_]:
        """(n,) bool: the sides that are drawn as such, not as chords of a curve."""
        length = self._turns.side_m
        alone = (length > MIN_SIDE_M) & (length > ALONE * np.maximum(np.roll(length, 1), np.roll(length, -1)))
        return np.asarray((self._turns.sagitta_m > CHORD_SHARE * tolerance_m) | alone, dtype=np.bool_)

    def _anchors(self, tolerance_m: float) -> NDArray[np.intp]:
        """The indices of the points that every polygon keeps: ends of straight sides, and corners between curves."""
        straight = self._straight(tolerance_m)
        turn = np.abs(self._turns.turn_rad)
        beside = 3.0 * np.maximum(np.roll(turn, 1), np.roll(turn, -1))
        sharp = (turn > 2.0 * MIN_TURN_RAD) & (turn > beside)
        return np.flatnonzero(straight | np.roll(straight, 1) | sharp)


def contour_of(entity: str, points_m: Array) -> Contour:
    """From the points (n, 2), m, of a closed curve, the last one the first. DrawingRefused where it encloses nothing,
    or crosses or touches itself."""
    if len(points_m) < 4:
        raise DrawingRefused(f"{entity} encloses no area; draw the peg's outline as one closed curve")
    # begun at a point that is a corner, if there are any, so that none is left on a straight side
    ring = points_m[:-1]
    first = int(np.argmax(np.hypot(*(ring - ring.mean(axis=0)).T)))
    polygon = Polygon(np.roll(ring, -first, axis=0))
    if not polygon.is_valid:
        why = explain_validity(polygon)
        raise DrawingRefused(f"{entity}: {why} (m); the outline may not cross or touch itself")
    if polygon.area <= FINE_M**2:
        raise DrawingRefused(f"{entity} encloses no area; draw the peg's outline as one closed curve")
    thinned = polygon.simplify(FINE_M)
    points = np.array(thinned.exterior.coords[:-1])
    if not thinned.exterior.is_ccw:
        points = points[::-1]
    centroid = np.array([polygon.centroid.x, polygon.centroid.y])
    return Contour(points - centroid, centroid)


def _round(radius_m: float, tolerance_m: float) -> Array:
    for count in ROUND_CHORDS:
        angles = np.arange(count) * (2.0 * np.pi / count)
        if radius_m * (1.0 - np.cos(np.pi / count)) <= tolerance_m:
            break
    return radius_m * np.column_stack([np.cos(angles), np.sin(angles)])


def _turn(angle_rad: float) -> Array:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])
