"""Overlapping convex parts whose union is a polygon, for a body that a physics engine treats as one.

An engine supports convex bodies only, and contacts may catch at the seam between two of them. So the parts here overlap
and are as large as possible: the borders of a part run along the polygon's edges and along their extensions inside
other parts, where nothing touches them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from shapely import Geometry, Polygon, get_parts

from crosspih_common.geometry.pose import Array

TOLERANCE_M = 1e-9
FAR_M = 10.0
MIN_AREA_M2 = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class ConvexRegion:
    """All points p (2,) with ``normals @ p <= offsets_m``, bounded: normals (k, 2) unit, offsets and corners in metres.

    `corners_m` (k, 2) counter-clockwise; edge i of the region lies on line i and goes from corner i to corner i + 1.
    """

    normals: Array
    offsets_m: Array
    corners_m: Array


Line = tuple[float, float, float]
"""(nx, ny, d): the half-plane nx x + ny y <= d, the normal of unit length."""


def half_plane(line: Line) -> Polygon:
    """The half-plane behind a line, as a very large square with one edge on the line."""
    nx, ny, d = line
    foot, along = np.array([nx, ny]) * d, np.array([-ny, nx]) * FAR_M
    back = np.array([nx, ny]) * FAR_M
    return Polygon([foot - along, foot + along, foot + along - back, foot - along - back])


def polygons(geometry: Geometry) -> list[Polygon]:
    """The polygons of a geometry, without those of negligible area."""
    found = [part for part in get_parts(geometry) if isinstance(part, Polygon)]
    return [part for part in found if part.area > MIN_AREA_M2]


def ring(polygon: Polygon) -> Array:
    """The corners (k, 2) counter-clockwise, without numerical duplicates."""
    corners = np.array(polygon.exterior.coords[:-1])
    if not polygon.exterior.is_ccw:
        corners = corners[::-1]
    return np.asarray(corners[np.hypot(*(corners - np.roll(corners, 1, axis=0)).T) > TOLERANCE_M])


def region_of(polygon: Polygon, lines: Sequence[Line]) -> ConvexRegion:
    """A convex polygon with exact edges: they are taken from the lines that bound it."""
    corners = ring(polygon)
    candidates = np.array(list(dict.fromkeys(lines)))
    beyond = corners @ candidates[:, :2].T - candidates[:, 2]
    # a line that other lines prolong may cross the region
    bounding = candidates[np.max(beyond, axis=0) <= TOLERANCE_M]
    kept: list[tuple[float, Array, Array]] = []
    for line in bounding:
        on = corners[corners @ line[:2] - line[2] > -TOLERANCE_M]
        along = on @ np.array([-line[1], line[0]])
        told = any(np.max(np.abs(line - other)) < TOLERANCE_M for _, other, _ in kept)
        if len(on) >= 2 and np.ptp(along) > 10.0 * TOLERANCE_M and not told:
            kept.append((float(np.arctan2(line[1], line[0])), line, on[np.argmin(along)]))
    kept.sort(key=lambda item: item[0])
    return ConvexRegion(
        np.array([line[:2] for _, line, _ in kept]),
        np.array([line[2] for _, line, _ in kept]),
        np.array([start for _, _, start in kept]),
    )


def cover(corners_m: Array, normals: Array, offsets_m: Array) -> list[ConvexRegion]:
    """Convex regions, each with the origin in it, whose union is a polygon (n, 2), counter-clockwise, m.

    `normals` and `offsets_m` are its edges' lines. ValueError when the origin does not see the whole polygon.
    """
    if np.any(offsets_m < -TOLERANCE_M):
        raise ValueError("only a polygon that its origin sees the whole of is covered by parts that hold the origin")
    polygon = Polygon(corners_m)
    edges: list[Line] = [(float(n[0]), float(n[1]), float(d)) for n, d in zip(normals, offsets_m, strict=True)]
    ends = np.roll(corners_m, -1, axis=0)
    seeds = [np.array([np.zeros(2), start, end]) for start, end in zip(corners_m, ends, strict=True)]
    seeds = [seed for seed in seeds if Polygon(seed).area > MIN_AREA_M2]
    candidates: list[ConvexRegion] = []
    for measure in (_area, _edges_kept):
        grown: list[ConvexRegion] = []
        for seed in seeds:
            if not any(_holds(part, seed) for part in grown):
                grown.append(_grown(polygon, edges, seed, measure))
        candidates += grown
    return _fewest(candidates, seeds)


def _holds(part: ConvexRegion, points_m: Array) -> bool:
    return bool(np.all(points_m @ part.normals.T <= part.offsets_m + TOLERANCE_M))


Measure = Callable[[Polygon, Sequence[Line]], float]


def _area(region: Polygon, edges: Sequence[Line]) -> float:
    return float(region.area)


def _edges_kept(region: Polygon, edges: Sequence[Line]) -> float:
    """The length of a region's border that lies on the outline, m."""
    corners = ring(region)
    ends = np.roll(corners, -1, axis=0)
    lines = np.array(edges)
    on = np.all([np.abs(points @ lines[:, :2].T - lines[:, 2]) < TOLERANCE_M for points in (corners, ends)], axis=0)
    return float(np.sum(np.hypot(*(ends - corners).T)[np.any(on, axis=1)]))


def _fewest(candidates: Sequence[ConvexRegion], seeds: Sequence[Array]) -> list[ConvexRegion]:
    """The fewest of the regions, chosen greedily, so that each seed is whole in one of them."""
    held = np.array([[_holds(part, seed) for seed in seeds] for part in candidates])
    found: list[ConvexRegion] = []
    while held.any():
        best = int(np.argmax(held.sum(axis=1)))
        found.append(candidates[best])
        held = held & ~held[best]
    return found


def _grown(polygon: Polygon, edges: list[Line], seed: Array, measure: Measure) -> ConvexRegion:
    """The polygon, cut along lines through its inward corners until it is convex, the seed kept whole.

    Of all cuts the one is made first that leaves most by the measure.
    """
    region, lines = polygon, list(edges)
    middle = Polygon(seed).representative_point()
    while True:
        corners = ring(region)
        step = np.roll(corners, -1, axis=0) - corners
        back = corners - np.roll(corners, 1, axis=0)
        sine = (back[:, 0] * step[:, 1] - back[:, 1] * step[:, 0]) / np.hypot(*back.T) / np.hypot(*step.T)
        inward = np.flatnonzero(sine < -1e-9)
        if len(inward) == 0:
            return region_of(region, lines)
        cuts = [_cuts(vertex, edges, seed) for vertex in corners[inward]]
        # where a corner leaves no choice the cut is made first: it may settle other corners with it
        forced = [choice for choice in cuts if len(choice) == 1]
        best: tuple[float, Polygon, Line] | None = None
        for line in dict.fromkeys(line for choice in forced or cuts for line in choice):
            kept = [part for part in polygons(region & half_plane(line)) if part.contains(middle)]
            # a cut that changes nothing would loop forever
            if kept and kept[0].area < region.area - MIN_AREA_M2:
                left = measure(kept[0], edges)
                if best is None or left > best[0]:
                    best = (left, kept[0], line)
        if best is None:
            raise ValueError("this outline has a detail too fine to be cut into convex parts; draw it coarser")
        _, region, line = best
        lines.append(line)


def _cuts(vertex: Array, edges: list[Line], seed: Array) -> list[Line]:
    """The half-planes along edges that have a corner on their line and keep the seed."""
    lines = dict.fromkeys(edges)
    at_corner = [line for line in lines if abs(vertex @ np.array(line[:2]) - line[2]) < TOLERANCE_M]
    return [line for line in at_corner if bool(np.all(seed @ np.array(line[:2]) <= line[2] + TOLERANCE_M))]
