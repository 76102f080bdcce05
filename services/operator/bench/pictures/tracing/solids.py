"""Triangles of the scenes: the plate with its hole as it was made, prisms, tubes; metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from shapely import Polygon, constrained_delaunay_triangles, get_parts
from shapely.geometry.base import BaseGeometry

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import ConvexPiece, Outline

TEXTURE_EXTENT_M = 0.2
"""A texture spans so much of a face, centred on the hole."""
ARC_STEPS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Triangles: vertices (n, 3) m, unit normals (n, 3), texture places (n, 2) 0..1, faces (m, 3)."""

    vertices_m: Array
    normals: Array
    places: Array
    faces: Array

    @classmethod
    def merged(cls, parts: Sequence[Solid]) -> Solid:
        """One of several."""
        starts = np.cumsum([0, *(len(part.vertices_m) for part in parts)])
        return cls(
            np.concatenate([part.vertices_m for part in parts]),
            np.concatenate([part.normals for part in parts]),
            np.concatenate([part.places for part in parts]),
            np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)]),
        )

    def at(self, pose: Pose) -> Solid:
        """The same in another frame."""
        return Solid(pose.apply(self.vertices_m), pose.rotate(self.normals), self.places, self.faces)

    def write(self, path: Path) -> None:
        """As a binary PLY file, float32."""
        count = len(self.vertices_m)
        names = ["x", "y", "z", "nx", "ny", "nz", "u", "v"]
        head = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
        head += [f"property float {name}" for name in names]
        head += [f"element face {len(self.faces)}", "property list uchar int vertex_indices", "end_header", ""]
        table = np.column_stack([self.vertices_m, self.normals, self.places]).astype("<f4")
        rows = np.zeros(len(self.faces), dtype=[("n", "u1"), ("i", "<i4", 3)])
        rows["n"], rows["i"] = 3, self.faces
        path.write_bytes("\n".join(head).encode() + table.tobytes() + rows.tobytes())


def flat(area: BaseGeometry, z_m: float, up: float = -1.0) -> Solid:
    """A flat area across z, its normal along `up` z; texture places are of the hole's frame."""
    corners: list[Array] = []
    faces: list[list[int]] = []
    for polygon in get_parts(area):
        if not isinstance(polygon, Polygon) or polygon.area <= 0.0:
            continue
        for triangle in get_parts(constrained_delaunay_triangles(polygon)):
            ring = np.array(triangle.exterior.coords[:-1])
            if triangle.exterior.is_ccw != (up > 0.0):
                ring = ring[::-1]
            faces.append([3 * len(corners), 3 * len(corners) + 1, 3 * len(corners) + 2])
            corners.append(ring)
    xy = np.concatenate(corners)
    return Solid(
        np.column_stack([xy, np.full(len(xy), z_m)]),
        np.tile([0.0, 0.0, up], (len(xy), 1)),
        xy / TEXTURE_EXTENT_M + 0.5,
        np.array(faces),
    )


def walls(rings_m: Sequence[Array], tilts_rad: Sequence[tuple[float, float]], into: Array) -> Solid:
    """The strips between rings (n, 3) of one outline, first to last.

    `into` (n, 2) are the directions in the plane that each edge's wall faces; a strip's normal turns from -z by the two
    angles of `tilts_rad`, at its first and at its second ring: 0 is a face, pi/2 a wall.
    """
    parts = []
    count = len(into)
    across = np.column_stack([into, np.zeros(count)])
    for (near, far), (first, second) in zip(pairwise(rings_m), tilts_rad, strict=True):
        corners = np.stack([near, np.roll(near, -1, axis=0), np.roll(far, -1, axis=0), far], axis=1)
        normals = np.empty((count, 4, 3))
        for index, tilt in enumerate((first, first, second, second)):
            normals[:, index] = np.sin(tilt) * across + np.cos(tilt) * np.array([0.0, 0.0, -1.0])
        along = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        start = np.concatenate([[0.0], np.cumsum(along)[:-1]])
        u = np.stack([start, start + along, start + along, start], axis=1)
        v = np.broadcast_to([near[0, 2], near[0, 2], far[0, 2], far[0, 2]], u.shape)
        places = np.stack([u, v], axis=-1).reshape(-1, 2) / TEXTURE_EXTENT_M
        base = 4 * np.arange(count)[:, None]
        faces = np.concatenate([base + np.array([0, 1, 2]), base + np.array([0, 2, 3])])
        parts.append(Solid(corners.reshape(-1, 3), normals.reshape(-1, 3), places, faces))
    return Solid.merged(parts)


@dataclass(frozen=True, slots=True)
class SolidRim:
    """A hole's rim as it was made: the bore's outline, the chamfer, and the radius of the two broken edges, m."""

    bore: Outline
    chamfer_m: float
    edge_break_m: float

    def ring_m(self, offset_m: float, z_m: float) -> Array:
        """(n, 3): the outline that far outside of the bore, at a depth."""
        corners = self.bore.grown(offset_m).corners_m if offset_m else self.bore.corners_m
        return np.column_stack([corners, np.full(len(corners), z_m)])

    def opening(self) -> Polygon:
        """What is missing of the face's plane: the chamfer and the outer edge's break included."""
        return Polygon(self.ring_m(self.chamfer_m + self._reach_m(), 0.0)[:, :2])

    def _reach_m(self) -> float:
        turn = np.pi / 4.0 if self.chamfer_m else np.pi / 2.0
        return float(self.edge_break_m * np.tan(turn / 2.0))

    def strips(self, depth_m: float) -> tuple[Solid, Solid]:
        """(rim, bore): the broken edges with the chamfer, and the walls down to a depth."""
        r, c, t = self.edge_break_m, self.chamfer_m, self._reach_m()
        profile: list[tuple[float, float]] = []
        tilts: list[float] = []

        def arc(offset_m: float, z_m: float, first: float, last: float) -> None:
            for tilt in np.linspace(first, last, ARC_STEPS + 1) if r else (first, last):
                profile.append((offset_m - r * np.sin(tilt), z_m - r * np.cos(tilt)))
                tilts.append(float(tilt))

        if c:
            arc(c + t, r, 0.0, np.pi / 4.0)
            arc(r, c + t, np.pi / 4.0, np.pi / 2.0)
        else:
            arc(r, r, 0.0, np.pi / 2.0)
        kept = [
            k for k in range(len(profile)) if k == 0 or np.ptp(np.array(profile[k - 1 : k + 1]), axis=0).max() > 1e-9
        ]
        rings = [self.ring_m(*profile[k]) for k in kept]
        # a strip between two arcs is flat: both its ends have the tilt that they share
        pairs = [(tilts[a], tilts[b]) for a, b in pairwise(kept)]
        if not r:
            pairs = [(np.pi / 4.0, np.pi / 4.0)] if c else []
        into = -self.bore.normals
        back = self.ring_m(0.0, depth_m)
        bore = walls([rings[-1], back], [(np.pi / 2.0, np.pi / 2.0)], into)
        return (walls(rings, pairs, into) if pairs else bore), bore


def prism(outline: Polygon, low_m: float, high_m: float) -> Solid:
    """A closed prism from z = low (its face towards the cameras) to high; holes of the polygon go through."""
    parts = [flat(outline, low_m, -1.0), flat(outline, high_m, 1.0)]
    for ring, sign in ((outline.exterior, 1.0), *((inner, -1.0) for inner in outline.interiors)):
        corners = np.array(ring.coords[:-1])
        if not ring.is_ccw:
            corners = corners[::-1]
        edges = np.roll(corners, -1, axis=0) - corners
        out = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
        near, far = (np.column_stack([corners, np.full(len(corners), z)]) for z in (low_m, high_m))
        parts.append(walls([near, far], [(np.pi / 2.0, np.pi / 2.0)], sign * out))
    return Solid.merged(parts)


def disc(radius_m: float, sides: int = 32, centre_m: tuple[float, float] = (0.0, 0.0)) -> Polygon:
    """A round as a polygon."""
    angles = np.arange(sides) * (2.0 * np.pi / sides)
    return Polygon(np.asarray(centre_m) + radius_m * np.column_stack([np.cos(angles), np.sin(angles)]))


def tube(path_m: Array, radius_m: float, sides: int = 16) -> Solid:
    """A round cable along points (n, 3)."""
    ahead = np.gradient(path_m, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    side = np.cross(ahead, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1)[:, None]
    up = np.cross(side, ahead)
    angles = np.arange(sides) * (2.0 * np.pi / sides)
    normals = np.cos(angles)[None, :, None] * side[:, None] + np.sin(angles)[None, :, None] * up[:, None]
    vertices = path_m[:, None] + radius_m * normals
    n = len(path_m)
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(n - 1), np.arange(sides), indexing="ij"))
    k = (j + 1) % sides
    a, b, c, d = i * sides + j, (i + 1) * sides + j, (i + 1) * sides + k, i * sides + k
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    places = np.column_stack([np.repeat(np.arange(n), sides) / n, np.tile(np.arange(sides), n) / sides])
    return Solid(vertices.reshape(-1, 3), normals.reshape(-1, 3), places, faces)


def box_solid(half_m: Sequence[float] | Array) -> Solid:
    """A box about the origin."""
    x, y, z = half_m
    return prism(Polygon([(-x, -y), (x, -y), (x, y), (-x, y)]), -z, z)


def convex_solid(pieces: Sequence[ConvexPiece]) -> Solid:
    """The faces of convex pieces, shaded flat."""
    parts = []
    for piece in pieces:
        corners = piece.vertices_m()
        for normal, offset in zip(piece.normals, piece.offsets_m, strict=True):
            ring = corners[np.abs(corners @ normal - offset) < 1e-9]
            if len(ring) < 3:
                continue
            middle = ring.mean(axis=0)
            first = ring[0] - middle
            second = np.cross(normal, first)
            order = np.argsort(np.arctan2((ring - middle) @ second, (ring - middle) @ first))
            fan = np.array([(0, k, k + 1) for k in range(1, len(ring) - 1)])
            parts.append(Solid(ring[order], np.tile(normal, (len(ring), 1)), np.zeros((len(ring), 2)), fan))
    return Solid.merged(parts)
