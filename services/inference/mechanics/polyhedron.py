"""The features of a convex piece: corners, proper faces, and edges with the two faces that meet in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import ConvexPiece

ON_FACE_M = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Polyhedron:
    """V corners, F faces and E edges of a convex piece, metres, in the frame of the piece.

    corners_m (V, 3); normals (F, 3) outward unit, offsets_m (F,); edges (E, 2) corner indices; edge_faces (E, 2): the
    faces (a, b) that meet in the edge, in the order in which b x a points along `edge_directions`, from the edge's
    first corner to its second. on_face (V, F): which corner lies on which face. Planes that only touch the piece, and
    second copies of a plane, are no faces.
    """

    corners_m: Array
    normals: Array
    offsets_m: Array
    edges: NDArray[np.intp]
    edge_faces: NDArray[np.intp]
    on_face: NDArray[np.bool_]

    @classmethod
    def of(cls, piece: ConvexPiece) -> Polyhedron:
        """From half-spaces; ValueError when they enclose no volume."""
        corners = piece.vertices_m()
        touching = np.abs(corners @ piece.normals.T - piece.offsets_m) < ON_FACE_M
        proper: list[int] = []
        for face in range(len(piece.normals)):
            on = corners[touching[:, face]]
            if len(on) < 3 or np.linalg.matrix_rank(on[1:] - on[0], tol=ON_FACE_M) < 2:
                continue
            if all(piece.normals[face] @ piece.normals[known] < 1.0 - 1e-12 for known in proper):
                proper.append(face)
        return cls._of_faces(corners, piece.normals[proper], piece.offsets_m[proper], touching[:, proper])

    @classmethod
    def hull(cls, corners_m: Array) -> Polyhedron:
        """The convex hull of corners (k, 3), m, all of which are corners of it."""
        equations = np.unique(np.round(ConvexHull(corners_m).equations, 10), axis=0)
        heights = corners_m @ equations[:, :3].T + equations[:, 3]
        return cls._of_faces(corners_m, equations[:, :3], -equations[:, 3], np.abs(heights) < ON_FACE_M)

    @classmethod
    def _of_faces(cls, corners: Array, normals: Array, offsets_m: Array, on_face: NDArray[np.bool_]) -> Polyhedron:
        edges: list[tuple[int, int]] = []
        edge_faces: list[tuple[int, int]] = []
        for first in range(len(corners)):
            for second in range(first + 1, len(corners)):
                shared = np.flatnonzero(on_face[first] & on_face[second])
                if len(shared) != 2:
                    continue
                a, b = int(shared[0]), int(shared[1])
                forth = float(np.cross(normals[b], normals[a]) @ (corners[second] - corners[first])) > 0.0
                edges.append((first, second))
                edge_faces.append((a, b) if forth else (b, a))
        return cls(corners, normals, offsets_m, np.array(edges), np.array(edge_faces), on_face)

    @property
    def edge_directions(self) -> Array:
        """Unit directions (E, 3) of the edges."""
        along = self.corners_m[self.edges[:, 1]] - self.corners_m[self.edges[:, 0]]
        return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))

    def extreme_within(self, direction: Array, angle_rad: float) -> NDArray[np.intp]:
        """The corners (k,) that are farthest along some direction within an angle (rad) of a unit direction (3,).

        The directions in which a corner is farthest make a spherical polygon whose sides are the arcs between the
        normals of the faces that meet in the corner's edges.
        """
        arcs = arc_point_angle(
            self.normals[self.edge_faces[:, 0]], self.normals[self.edge_faces[:, 1]], direction[None]
        )
        along = self.edge_directions @ direction
        angle = np.zeros(len(self.corners_m))
        for corner in range(len(self.corners_m)):
            starts, ends = self.edges[:, 0] == corner, self.edges[:, 1] == corner
            if np.any(along[starts] > 0.0) or np.any(along[ends] < 0.0):
                angle[corner] = arcs[starts | ends].min()
        return np.flatnonzero(angle <= angle_rad + 1e-9)


def arc_point_angle(one: Array, other: Array, point: Array) -> Array:
    """The angle (..., rad) from unit vectors (..., 3) to the short great-circle arcs between one and other (..., 3)."""
    pole = np.cross(one, other)
    pole = pole / np.maximum(np.linalg.norm(pole, axis=-1, keepdims=True), 1e-12)

    def dot(a: Array, b: Array) -> Array:
        return np.asarray(np.einsum("...i,...i->...", a, b))

    beside = (dot(np.cross(pole, one), point) >= 0.0) & (dot(np.cross(other, pole), point) >= 0.0)
    to_circle = np.arcsin(np.clip(np.abs(dot(pole, point)), 0.0, 1.0))
    to_ends = np.arccos(np.clip(np.maximum(dot(one, point), dot(other, point)), -1.0, 1.0))
    return np.asarray(np.where(beside, to_circle, to_ends))


def arc_arc_angle(a: Array, b: Array, c: Array, d: Array) -> Array:
    """The least angle (..., rad) between the arcs a-b and c-d (..., 3) of the unit sphere; 0 where they cross.

    Two great circles that do not cross within the arcs are nearest at an end of one of them.
    """
    ab, cd = np.cross(a, b), np.cross(c, d)

    def dot(x: Array, y: Array) -> Array:
        return np.asarray(np.einsum("...i,...i->...", x, y))

    crossing = (dot(ab, c) * dot(ab, d) < 0.0) & (dot(cd, a) * dot(cd, b) < 0.0) & (dot(ab, c) * dot(cd, b) > 0.0)
    ends = np.minimum(
        np.minimum(arc_point_angle(a, b, c), arc_point_angle(a, b, d)),
        np.minimum(arc_point_angle(c, d, a), arc_point_angle(c, d, b)),
    )
    return np.asarray(np.where(crossing, 0.0, ends))
