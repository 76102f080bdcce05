"""The plate with its hole as it is seen, every face once: the blocks that collide overlap, and are slow to draw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from shapely import Polygon, box, constrained_delaunay_triangles, get_parts

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole
from services.hardware.drivers.simulated.scene.scene_mesh import Mesh, box_mesh


def fixture_meshes(hole: Hole) -> dict[str, Mesh]:
    """The fixture in the hole frame: `face` (plate and chamfer), `bore` (walls), `blank` (a plate without a hole)."""
    half, depth = hole.plate_half_size_m, hole.depth_m
    blank = box_mesh((half, half, depth / 2), (0.0, 0.0, depth / 2))
    outer, inner = hole.outer_rim_m(), hole.inner_rim_m()
    back = np.column_stack([inner[:, :2], np.full(len(inner), depth)])
    into_hole = np.column_stack([-hole.outline.normals, np.zeros(len(inner))])
    face = [_flat(outer, half, -1.0), _flat(back, half, 1.0), _sides(blank)]
    if hole.chamfer_m > 0.0:
        face.append(_strip(outer, inner, (into_hole - [0.0, 0.0, 1.0]) / np.sqrt(2.0)))
    return {"face": Mesh.merged(face), "bore": _strip(inner, back, into_hole), "blank": blank}


def _facets(rings: Sequence[Array], normals: Array) -> Mesh:
    """Convex facets (k, 3), anticlockwise from outside, with their normals (n, 3)."""
    indices: list[int] = []
    start = 0
    for ring in rings:
        indices.extend(start + corner for k in range(1, len(ring) - 1) for corner in (0, k, k + 1))
        start += len(ring)
    counts = [len(ring) for ring in rings]
    return Mesh(np.concatenate(rings), np.repeat(np.asarray(normals, float), counts, axis=0), indices)


def _flat(rim_m: Array, half_size_m: float, up: float) -> Mesh:
    """The plate's face in the plane of a rim (n, 3), without the opening; `up` is its normal's z."""
    plate = box(-half_size_m, -half_size_m, half_size_m, half_size_m) - Polygon(rim_m[:, :2])
    rings = []
    for triangle in get_parts(constrained_delaunay_triangles(plate)):
        corners = np.array(triangle.exterior.coords[:-1])
        if triangle.exterior.is_ccw != (up > 0.0):
            corners = corners[::-1]
        rings.append(np.column_stack([corners, np.full(3, rim_m[0, 2])]))
    return _facets(rings, np.tile([0.0, 0.0, up], (len(rings), 1)))


def _strip(near_m: Array, far_m: Array, normals: Array) -> Mesh:
    """The walls between two rims (n, 3), counter-clockwise, seen from within."""
    corners = (far_m, np.roll(far_m, -1, axis=0), np.roll(near_m, -1, axis=0), near_m)
    return _facets(list(np.stack(corners, axis=1)), normals)


def _sides(plate: Mesh) -> Mesh:
    """The four sides of a plate."""
    triangles = np.array(plate.indices).reshape(-1, 3)
    upright = np.abs(plate.normals[triangles[:, 0], 2]) < 0.5
    return Mesh(plate.vertices_m, plate.normals, triangles[upright].ravel().tolist())
