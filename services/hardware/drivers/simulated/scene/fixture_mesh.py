"""The plate with its hole as it is seen, every face once: the blocks that collide overlap, and are slow to draw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, box, constrained_delaunay_triangles, get_parts

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole
from services.hardware.drivers.simulated.scene.scene_mesh import RenderMesh, box_mesh

WAYS = 24
"""Chamfers that face nearly the same way are one body: so many ways at most."""


def fixture_meshes(hole: Hole) -> dict[str, RenderMesh]:
    """The fixture in the hole frame: `face` (the outer one), `sides` (and the back), `bore` (walls), `blank` (an outer
    face without a hole)."""
    half, depth = hole.plate_half_size_m, hole.depth_m
    whole = box_mesh((half, half, depth / 2), (0.0, 0.0, depth / 2))
    outer, inner = hole.outer_rim_m(), hole.inner_rim_m()
    back = np.column_stack([inner[:, :2], np.full(len(inner), depth)])
    into_hole = np.column_stack([-hole.outline.normals, np.zeros(len(inner))])
    square = np.array([[-half, half, 0.0], [half, half, 0.0], [half, -half, 0.0], [-half, -half, 0.0]])
    return {
        "face": _around(outer, half, -1.0),
        "sides": RenderMesh.merged([_around(back, half, 1.0), _sides(whole)]),
        "bore": _strip(inner, back, into_hole),
        "blank": _facets([square], np.array([[0.0, 0.0, -1.0]])),
    }


def chamfer_meshes(hole: Hole) -> list[tuple[Array, RenderMesh]]:
    """The chamfer in the hole frame, in parts that face one way each: (normal (3,), mesh); none where it has none."""
    if hole.chamfer_m == 0.0:
        return []
    outer, inner = hole.outer_rim_m(), hole.inner_rim_m()
    inwards = -hole.outline.normals
    way = np.rint(np.arctan2(inwards[:, 1], inwards[:, 0]) * WAYS / (2.0 * np.pi)).astype(int) % WAYS
    normals = np.column_stack([inwards, np.full(len(inwards), -1.0)]) / np.sqrt(2.0)
    parts = []
    for one in np.unique(way).tolist():
        chosen = np.flatnonzero(way == one)
        middle = normals[chosen].mean(axis=0)
        parts.append((middle / np.linalg.norm(middle), _strip(outer, inner, normals, chosen)))
    return parts


def bottom_mesh(hole: Hole, depth_m: float) -> RenderMesh:
    """What closes a blind hole at a depth below the outer face, in the hole frame."""
    rim = hole.inner_rim_m()[:, :2]
    return _flat(Polygon(rim), depth_m, -1.0)


def _facets(rings: Sequence[Array], normals: Array) -> RenderMesh:
    """Convex facets (k, 3), anticlockwise from outside, with their normals (n, 3)."""
    indices: list[int] = []
    start = 0
    for ring in rings:
        indices.extend(start + corner for k in range(1, len(ring) - 1) for corner in (0, k, k + 1))
        start += len(ring)
    counts = [len(ring) for ring in rings]
    return RenderMesh(np.concatenate(rings), np.repeat(np.asarray(normals, float), counts, axis=0), indices)


def _around(rim_m: Array, half_size_m: float, up: float) -> RenderMesh:
    """The plate's face in the plane of a rim (n, 3), without the opening; `up` is its normal's z."""
    plate = box(-half_size_m, -half_size_m, half_size_m, half_size_m) - Polygon(rim_m[:, :2])
    return _flat(plate, float(rim_m[0, 2]), up)


def _flat(area: Polygon, z_m: float, up: float) -> RenderMesh:
    """An area at a height; `up` is its normal's z."""
    rings = []
    for triangle in get_parts(constrained_delaunay_triangles(area)):
        corners = np.array(triangle.exterior.coords[:-1])
        if triangle.exterior.is_ccw != (up > 0.0):
            corners = corners[::-1]
        rings.append(np.column_stack([corners, np.full(3, z_m)]))
    return _facets(rings, np.tile([0.0, 0.0, up], (len(rings), 1)))


def _strip(near_m: Array, far_m: Array, normals: Array, chosen: NDArray[np.intp] | None = None) -> RenderMesh:
    """The walls between two rims (n, 3), counter-clockwise, seen from within; only those `chosen` where given."""
    corners = np.stack((far_m, np.roll(far_m, -1, axis=0), np.roll(near_m, -1, axis=0), near_m), axis=1)
    some = np.arange(len(corners)) if chosen is None else chosen
    return _facets(list(corners[some]), normals[some])


def _sides(plate: RenderMesh) -> RenderMesh:
    """The four sides of a plate."""
    triangles = np.array(plate.indices).reshape(-1, 3)
    upright = np.abs(plate.normals[triangles[:, 0], 2]) < 0.5
    return RenderMesh(plate.vertices_m, plate.normals, triangles[upright].ravel().tolist())
