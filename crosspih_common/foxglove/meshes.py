"""Peg and plate as triangles: exactly as drawn, any outline."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, constrained_delaunay_triangles, get_parts

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole, Peg

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class TriangleMesh:
    """`corners_m` (n, 3), and `triangles` (m, 3) of their numbers, counter-clockwise seen from outside."""

    corners_m: Array
    triangles: Indices


def peg_mesh(peg: Peg) -> TriangleMesh:
    """The peg in its own frame {J}."""
    heights = (peg.body_start_m, peg.taper_start_m, peg.tip_m)
    rings = [peg.outline_m(height) for height in heights]
    tip = _cap(rings[-1], up=True)
    return _together([_cap(rings[0], up=False), *(_wall(low, high) for low, high in pairwise(rings)), tip])


def plate_mesh(hole: Hole) -> TriangleMesh:
    """The plate around the hole, in the hole's frame {D}: z = 0 is its outer face."""
    half, depth = hole.plate_half_size_m, hole.depth_m
    square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    outer, inner = hole.outer_rim_m(), hole.inner_rim_m()
    bottom = inner.copy()
    bottom[:, 2] = depth
    faces = [
        _cap(np.column_stack([square, np.zeros(4)]), up=False, opening_m=outer),
        _cap(np.column_stack([square, np.full(4, depth)]), up=True, opening_m=bottom),
        _wall(np.column_stack([square, np.zeros(4)]), np.column_stack([square, np.full(4, depth)])),
    ]
    if hole.chamfer_m > 0.0:
        faces.append(_wall(inner, outer))
    return _together([*faces, _wall(bottom, inner)])


def _wall(low_m: Array, high_m: Array) -> TriangleMesh:
    """The wall between two rings of n corners, counter-clockwise seen from +z; outward if `high_m` is above `low_m`."""
    count = len(low_m)
    here = np.arange(count)
    after = (here + 1) % count
    first = np.column_stack([here, after, after + count])
    second = np.column_stack([here, after + count, here + count])
    return TriangleMesh(np.concatenate([low_m, high_m]), np.concatenate([first, second]))


def _cap(ring_m: Array, up: bool, opening_m: Array | None = None) -> TriangleMesh:
    """The area of a plane ring without an opening in it; visible from +z or, if `up` is False, from -z."""
    polygon = Polygon(ring_m[:, :2], [] if opening_m is None else [opening_m[:, :2]])
    corners: list[Array] = []
    triangles: list[list[int]] = []
    for triangle in get_parts(constrained_delaunay_triangles(polygon)):
        ring = np.array(triangle.exterior.coords[:-1])
        if triangle.exterior.is_ccw != up:
            ring = ring[::-1]
        triangles.append([len(corners) * 3 + index for index in range(3)])
        corners.append(ring)
    flat = np.concatenate(corners)
    return TriangleMesh(np.column_stack([flat[:, :2], np.full(len(flat), ring_m[0, 2])]), np.array(triangles))


def _together(meshes: list[TriangleMesh]) -> TriangleMesh:
    starts = np.cumsum([0, *(len(mesh.corners_m) for mesh in meshes[:-1])])
    return TriangleMesh(
        np.concatenate([mesh.corners_m for mesh in meshes]),
        np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=True)]),
    )
