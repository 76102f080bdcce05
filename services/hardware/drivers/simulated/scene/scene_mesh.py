"""Flat and round triangle meshes for pictures of the cell: each face has its own corners, so that it is shaded flat."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import ConvexPiece

FacetFilter = Callable[[Array, float], bool]


@dataclass(frozen=True, slots=True, eq=False)
class RenderMesh:
    """Triangles for a renderer: vertices (n, 3) m, unit normals (n, 3), indices (3 k,), anticlockwise from outside."""

    vertices_m: Array
    normals: Array
    indices: list[int]

    @classmethod
    def merged(cls, parts: Sequence[RenderMesh]) -> RenderMesh:
        """One mesh of several."""
        indices: list[int] = []
        start = 0
        for part in parts:
            indices.extend(index + start for index in part.indices)
            start += len(part.vertices_m)
        return cls(
            np.concatenate([part.vertices_m for part in parts]),
            np.concatenate([part.normals for part in parts]),
            indices,
        )

    def corners_m(self) -> Array:
        """The 8 corners (8, 3) of the bounding box, m."""
        low, high = self.vertices_m.min(axis=0), self.vertices_m.max(axis=0)
        grid = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
        return np.asarray(low + grid * (high - low), dtype=float)


def convex_mesh(pieces: Sequence[ConvexPiece], keep: FacetFilter | None = None) -> RenderMesh:
    """The faces of convex pieces as flat-shaded fans; `keep(normal, offset_m)` picks the faces to draw."""
    parts = []
    for piece in pieces:
        corners = piece.vertices_m()
        for normal, offset in zip(piece.normals, piece.offsets_m, strict=True):
            if keep is not None and not keep(normal, float(offset)):
                continue
            ring = corners[np.abs(corners @ normal - offset) < 1e-9]
            if len(ring) >= 3:
                parts.append(_fan(ring, normal))
    return RenderMesh.merged(parts)


def box_mesh(half_sizes_m: Sequence[float], centre_m: Sequence[float] = (0.0, 0.0, 0.0)) -> RenderMesh:
    """A box about a centre, m."""
    half, centre = np.asarray(half_sizes_m, float), np.asarray(centre_m, float)
    planes = [((axis == 0) * sign, (axis == 1) * sign, (axis == 2) * sign) for axis in range(3) for sign in (1.0, -1.0)]
    normals = np.array(planes, dtype=float)
    return convex_mesh([ConvexPiece(normals, np.abs(normals) @ half + normals @ centre)])


def capsule_mesh(start_m: Array, end_m: Array, radius_m: float, sides: int = 20) -> RenderMesh:
    """A smooth-shaded capsule between two points (each (3,), m); a ball when they coincide."""
    axis = np.asarray(end_m, float) - np.asarray(start_m, float)
    length = float(np.linalg.norm(axis))
    along = axis / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    side = np.cross(along, [1.0, 0.0, 0.0] if abs(along[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    frame = np.column_stack([side, np.cross(along, side), along])
    around = np.arange(sides) * 2.0 * np.pi / sides
    rows = [(latitude, start_m) for latitude in np.linspace(-np.pi / 2, 0.0, 6)]
    rows += [(latitude, end_m) for latitude in np.linspace(0.0, np.pi / 2, 6)]
    vertices, normals = [], []
    for latitude, centre in rows:
        ring = np.column_stack(
            [np.cos(latitude) * np.cos(around), np.cos(latitude) * np.sin(around), np.full(sides, np.sin(latitude))]
        )
        normals.append(ring @ frame.T)
        vertices.append(np.asarray(centre, float) + radius_m * normals[-1])
    indices: list[int] = []
    for row in range(len(rows) - 1):
        for column in range(sides):
            a, b = row * sides + column, row * sides + (column + 1) % sides
            indices.extend([a, b, b + sides, a, b + sides, a + sides])
    return RenderMesh(np.concatenate(vertices), np.concatenate(normals), indices)


def _fan(ring: Array, normal: Array) -> RenderMesh:
    centre = ring.mean(axis=0)
    first = (ring[0] - centre) / np.linalg.norm(ring[0] - centre)
    angles = np.arctan2((ring - centre) @ np.cross(normal, first), (ring - centre) @ first)
    ordered = ring[np.argsort(angles)]
    indices = [index for k in range(1, len(ring) - 1) for index in (0, k, k + 1)]
    return RenderMesh(ordered, np.repeat(np.asarray(normal, float)[None], len(ring), axis=0), indices)
