"""The plate around a chamfered opening as convex blocks, exactly.

Every edge of the opening has a block with this whole edge on its border. The block reaches as far as possible, bounded
by the lines of other edges that it would cross. All its walls recede together along the chamfer. So the union of the
blocks is exact at every depth, also at the corners: at a corner that turns into the hole two blocks overlap, at a
corner that turns into the plate one block has both walls. No seam ends on a wall.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from shapely import Polygon, box, constrained_delaunay_triangles, get_parts, union_all

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.convex import ConvexPiece
from crosspih_common.shapes.cover import MIN_AREA_M2, TOLERANCE_M, Line, half_plane, polygons, ring
from crosspih_common.shapes.outline import Outline

SPLITS = 4
WRONG_AREA_M2 = 1e-10
Plane = tuple[tuple[float, float, float], float]


@lru_cache(maxsize=32)
def plate_blocks(outline: Outline, chamfer_m: float, depth_m: float, half_size_m: float) -> list[ConvexPiece]:
    """Convex blocks (hole frame) whose union is the plate from z = 0 to `depth_m` around the opening.

    Raises ValueError when the outline has details finer than the chamfer.
    """
    plate = box(-half_size_m, -half_size_m, half_size_m, half_size_m)
    outer = outline.grown(chamfer_m)
    openings = {back: Polygon(outline.grown(back).corners_m) for back in (0.0, chamfer_m / 2.0, chamfer_m)}
    walls: list[tuple[int, ...]] = []
    for edge in range(len(outline.corners_m)):
        for chosen in _walls_of(outline, outer, edge, plate):
            if chosen not in walls:
                walls.append(chosen)
    regions = {back: [_region(plate, outline, chosen, back) for chosen in walls] for back in openings}
    # areas that no block reaches are filled behind the chamfer, with straight walls
    rest = polygons(plate - openings[chamfer_m] - union_all(regions[chamfer_m]))
    fillers = [triangle for part in rest for triangle in get_parts(constrained_delaunay_triangles(part))]
    for back, opening in openings.items():
        solid = union_all([*regions[back], *fillers])
        if (solid ^ (plate - opening)).area > WRONG_AREA_M2:
            raise ValueError(
                f"outline {outline.name}: it has details finer than the chamfer of {chamfer_m * 1e3:g} mm; take a "
                f"smaller chamfer or draw it coarser"
            )
    slab: list[Plane] = [((0.0, 0.0, -1.0), 0.0), ((0.0, 0.0, 1.0), depth_m)]
    blocks = [
        ConvexPiece.from_planes([*_wall_planes(outline, chosen, chamfer_m), *_sides(region, half_size_m), *slab])
        for chosen, region in zip(walls, regions[0.0], strict=True)
    ]
    return blocks + [ConvexPiece.from_planes([*_faces(triangle), *slab]) for triangle in fillers]


def _behind(outline: Outline, edge: int, back_m: float) -> Line:
    nx, ny = outline.normals[edge]
    return (-float(nx), -float(ny), -float(outline.offsets_m[edge]) - back_m)


def _region(plate: Polygon, outline: Outline, walls: tuple[int, ...], back_m: float) -> Polygon:
    region = plate
    for edge in walls:
        region = region & half_plane(_behind(outline, edge, back_m))
    return region


def _walls_of(outline: Outline, outer: Outline, edge: int, plate: Polygon) -> list[tuple[int, ...]]:
    """For one edge: the edges whose lines bound its block; for an edge that has to be split, one tuple a part.

    `outer` is the outline on the plate's face.
    """
    rims = np.stack([outline.corners_m, outer.corners_m])
    ends = np.stack([rims[:, edge], np.roll(rims, -1, axis=1)[:, edge]], axis=1)
    opening = Polygon(outline.corners_m)

    def of(segments: Array, splits: int) -> list[tuple[int, ...]]:
        chosen = _separating(outline, outer, edge, segments, opening, plate)
        if chosen is not None:
            return [chosen]
        if splits == 0:
            raise ValueError(
                f"outline {outline.name}: no convex block fits behind edge {edge}; draw this detail coarser"
            )
        middle = segments.mean(axis=1)
        first, last = np.stack([segments[:, 0], middle], axis=1), np.stack([middle, segments[:, 1]], axis=1)
        return [*of(first, splits - 1), *of(last, splits - 1)]

    return of(ends, SPLITS)


def _separating(
    outline: Outline, outer: Outline, edge: int, segments: Array, opening: Polygon, plate: Polygon
) -> tuple[int, ...] | None:
    """The edges, including this one, whose lines separate the opening from a region that holds the segments.

    segments (2, 2, 2): both ends on the bore's rim, then both on the face's rim.
    """
    in_front = [
        np.all(ends @ outline.normals.T - rim.offsets_m >= -TOLERANCE_M, axis=0)
        for ends, rim in zip(segments, (outline, outer), strict=True)
    ]
    lines = np.column_stack([outline.normals, outline.offsets_m])
    # of several edges on one line only the first is kept
    same = np.argmax(np.max(np.abs(lines[:, None] - lines[None]), axis=-1) < TOLERANCE_M, axis=1)
    usable = sorted({int(same[other]) for other in np.flatnonzero(np.all(in_front, axis=0))})
    chosen = [int(same[edge])]
    region = plate & half_plane(_behind(outline, edge, 0.0))
    while sum(part.area for part in polygons(region & opening)) > MIN_AREA_M2:
        best: tuple[int, int, int] | None = None
        for other in usable:
            # a line that already bounds the region cuts off nothing, or by rounding all of it
            if other in chosen:
                continue
            cut = region & half_plane(_behind(outline, other, 0.0))
            if cut.area <= MIN_AREA_M2:
                continue
            left = sum(part.area for part in polygons(cut & opening))
            rank = (round(left / MIN_AREA_M2), -round(cut.area / MIN_AREA_M2), other)
            if best is None or rank < best:
                best = rank
        if best is None:
            return None
        chosen.append(best[2])
        region = region & half_plane(_behind(outline, best[2], 0.0))
    return tuple(sorted(chosen))


def _wall_planes(outline: Outline, walls: tuple[int, ...], chamfer_m: float) -> list[Plane]:
    planes: list[Plane] = []
    for edge in walls:
        nx, ny, d = _behind(outline, edge, 0.0)
        planes.append(((nx, ny, 0.0), d))
        if chamfer_m > 0.0:
            planes.append(((nx, ny, -1.0), d - chamfer_m))
    return planes


def _sides(region: Polygon, half_size_m: float) -> list[Plane]:
    """The sides of the plate that the region reaches."""
    low_x, low_y, high_x, high_y = region.bounds
    reached = ((1.0, 0.0, high_x), (-1.0, 0.0, -low_x), (0.0, 1.0, high_y), (0.0, -1.0, -low_y))
    return [((nx, ny, 0.0), half_size_m) for nx, ny, far in reached if abs(far - half_size_m) < TOLERANCE_M]


def _faces(triangle: Polygon) -> list[Plane]:
    corners = ring(triangle)
    planes: list[Plane] = []
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.hypot(bx - ax, by - ay))
        nx, ny = (by - ay) / length, -(bx - ax) / length
        planes.append(((float(nx), float(ny), 0.0), float(nx * ax + ny * ay)))
    return planes
