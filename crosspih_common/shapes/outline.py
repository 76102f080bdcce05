"""The section of a peg or of a hole: a simple polygon about the axis."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from shapely import LinearRing, Polygon
from shapely import points as shapely_points
from shapely.validation import explain_validity

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.cover import ConvexRegion, cover

MIN_EDGE_M = 1e-6
ROUND_FROM = 24
"""A polygon that comes back onto itself by that small a share of a turn, or a smaller one, counts as round."""
ROUND_M = 5e-5
"""So does one that nowhere leaves a circle about the axis by more, however its sides are spread."""


@dataclass(frozen=True)
class Outline:
    """A simple polygon in the plane across the axis, which is the origin and lies inside; metres.

    `symmetry_order` is how many turns about the axis bring it onto itself: 4 for a cross, 1 for a keyed round, 0 for
    a round, which any turn does. `points_m` are the corners, counter-clockwise. Raises ValueError naming the mend.
    """

    name: str
    points_m: tuple[tuple[float, float], ...]
    symmetry_order: int

    @classmethod
    def of(cls, name: str, corners_m: Array | Iterable[Sequence[float]], symmetry_order: int | None = None) -> Outline:
        """From corners (n, 2), m, either way round; the symmetry is found where it is not given."""
        corners = np.asarray(list(corners_m) if not isinstance(corners_m, np.ndarray) else corners_m, dtype=float)
        if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.all(np.isfinite(corners)):
            raise ValueError(f"outline {name}: wants three corners (x, y) or more, got an array of {corners.shape}")
        x, y = corners.T
        if float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) < 0.0:
            corners = corners[::-1]
        order = symmetry_order if symmetry_order is not None else symmetry_of(corners)
        return cls(name, tuple((float(px), float(py)) for px, py in corners), order)

    def __post_init__(self) -> None:
        corners = self.corners_m
        edges = np.roll(corners, -1, axis=0) - corners
        short = np.flatnonzero(np.hypot(edges[:, 0], edges[:, 1]) < MIN_EDGE_M)
        if len(short):
            raise ValueError(f"outline {self.name}: corners {short[0]} and {short[0] + 1} coincide; leave one out")
        polygon = Polygon(corners)
        if not polygon.is_valid:
            why = explain_validity(polygon)
            raise ValueError(f"outline {self.name}: {why} (m); it may not cross or touch itself")
        if not polygon.exterior.is_ccw:
            raise ValueError(f"outline {self.name}: its corners run clockwise; make it with Outline.of")
        if not polygon.contains(_AXIS):
            raise ValueError(f"outline {self.name}: the peg's axis (0, 0) is not inside it; move it over the axis")

    @cached_property
    def corners_m(self) -> Array:
        """(n, 2), m, counter-clockwise, read-only."""
        corners = np.array(self.points_m, dtype=float)
        corners.setflags(write=False)
        return corners

    @property
    def radius_m(self) -> float:
        """How far the farthest corner is from the axis."""
        return float(np.max(np.hypot(*self.corners_m.T)))

    @property
    def reach_m(self) -> float:
        """How far it reaches along x or y, whichever is more: half of a square that holds it."""
        return float(np.max(np.abs(self.corners_m)))

    @cached_property
    def inner_radius_m(self) -> float:
        """How far the nearest point of the outline is from the axis."""
        return float(Polygon(self.corners_m).exterior.distance(_AXIS))

    @cached_property
    def area_m2(self) -> float:
        """The area, m^2."""
        return float(Polygon(self.corners_m).area)

    @cached_property
    def normals(self) -> Array:
        """(n, 2): the outward unit normal of the edge from corner i to corner i + 1."""
        x, y = (np.roll(self.corners_m, -1, axis=0) - self.corners_m).T
        return np.asarray(np.column_stack([y, -x]) / np.hypot(x, y)[:, None])

    @cached_property
    def offsets_m(self) -> Array:
        """(n,): how far each edge's line is from the axis, m; negative where the axis lies outside of it."""
        return np.asarray(np.sum(self.normals * self.corners_m, axis=1))

    @cached_property
    def reentrant(self) -> Array:
        """(n,) bool: the corners at which the outline turns inward; these cannot touch a rim from inside."""
        before = np.roll(self.normals, 1, axis=0)
        turn = before[:, 0] * self.normals[:, 1] - before[:, 1] * self.normals[:, 0]
        return np.asarray(turn < -1e-9)

    def convex_parts(self) -> list[ConvexRegion]:
        """Convex parts, overlapping, whose union is the outline, as large as they go; see `cover`."""
        return list(self._parts)

    @cached_property
    def _parts(self) -> tuple[ConvexRegion, ...]:
        return tuple(cover(self.corners_m, self.normals, self.offsets_m))

    def grown(self, margin_m: float) -> Outline:
        """Every edge moved outward by a margin (m), corners mitred: corner i stays corner i.

        Raises ValueError where the outline closes up or an edge vanishes.
        """
        before = np.roll(self.normals, 1, axis=0)
        mitre = (before + self.normals) / (1.0 + np.sum(before * self.normals, axis=1))[:, None]
        corners = self.corners_m + margin_m * mitre
        edges = np.roll(corners, -1, axis=0) - corners
        kept = edges[:, 1] * self.normals[:, 0] - edges[:, 0] * self.normals[:, 1] > MIN_EDGE_M
        if not np.all(kept) or not Polygon(corners).is_valid:
            raise ValueError(
                f"outline {self.name}: cannot be widened by {margin_m * 1e3:g} mm, a detail closes up; take a smaller "
                f"clearance or chamfer, or a coarser outline"
            )
        return Outline(self.name, tuple((float(x), float(y)) for x, y in corners), self.symmetry_order)


_AXIS = Polygon([(0.0, 0.0), (1e-9, 0.0), (0.0, 1e-9)]).representative_point()


def symmetry_of(corners_m: Array, tolerance_m: float = 1e-5) -> int:
    """The number of rotations about the origin that map a polygon (n, 2) onto itself within a tolerance, m; 0 if round.

    It compares the corners if they are evenly spread, else the line that they form.
    """
    count = len(corners_m)
    points = corners_m[:, 0] + 1j * corners_m[:, 1]
    for order in sorted((k for k in range(2, count + 1) if count % k == 0), reverse=True):
        turned = np.roll(points * np.exp(2j * np.pi / order), count // order)
        if np.max(np.abs(turned - points)) < tolerance_m:
            return 0 if order >= ROUND_FROM else order
    ring = LinearRing(corners_m)
    if np.max(np.abs(points)) - ring.distance(_AXIS) <= ROUND_M:
        return 0
    for order in range(ROUND_FROM, 1, -1):
        there, back = (points * np.exp(sign * 2j * np.pi / order) for sign in (1.0, -1.0))
        turned = np.concatenate([there, back])
        if np.max(ring.distance(shapely_points(turned.real, turned.imag))) < tolerance_m:
            return 0 if order >= ROUND_FROM else order
    return 1
