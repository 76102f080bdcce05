"""A convex piece as an intersection of half-spaces, from which corners, insets and meshes follow exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPiece:
    """All points p with ``normals @ p <= offsets_m``: normals (n, 3) outward and unit, offsets (n,) in metres."""

    normals: Array
    offsets_m: Array

    @classmethod
    def from_planes(cls, planes: list[tuple[tuple[float, float, float], float]]) -> ConvexPiece:
        """From (outward normal of any length, offset along that normal): n . p <= offset."""
        normals = np.array([plane[0] for plane in planes], dtype=float)
        lengths = np.linalg.norm(normals, axis=1)
        return cls(normals / lengths[:, None], np.array([plane[1] for plane in planes], dtype=float) / lengths)

    def inset(self, margin_m: float) -> ConvexPiece:
        """The piece with every face moved inward by a margin (m): exact for a collision margin put back on faces."""
        return ConvexPiece(self.normals, self.offsets_m - margin_m)

    def interior_point_m(self) -> Array:
        """The centre (3,) of the largest ball inside (Chebyshev centre), m; ValueError when the piece is empty."""
        from scipy.optimize import linprog  # a quarter of a second to load, and only a mesh wants it

        result = linprog(
            [0.0, 0.0, 0.0, -1.0],
            A_ub=np.column_stack([self.normals, np.ones(len(self.normals))]),
            b_ub=self.offsets_m,
            bounds=[(None, None)] * 3 + [(0.0, None)],
        )
        found = result.x
        if found is None or found[3] <= 0.0:
            raise ValueError("the half-spaces of this convex piece do not enclose a volume")
        return np.asarray(found[:3], dtype=float)

    def vertices_m(self) -> Array:
        """The corners (k, 3), m, sorted so that the same piece always lists them in the same order."""
        from scipy.spatial import HalfspaceIntersection

        halfspaces = np.column_stack([self.normals, -self.offsets_m])
        corners = HalfspaceIntersection(halfspaces, self.interior_point_m()).intersections
        unique = np.unique(np.round(corners, 12), axis=0)
        keep = [0]
        for index in range(1, len(unique)):
            if np.min(np.linalg.norm(unique[keep] - unique[index], axis=1)) > 1e-9:
                keep.append(index)
        return np.asarray(unique[keep], dtype=float)

    def contains(self, points_m: Array, slack_m: float = 0.0) -> Array:
        """Whether each point (..., 3) lies inside, within a slack (m); boolean (...,)."""
        return np.asarray(np.all(points_m @ self.normals.T <= self.offsets_m + slack_m, axis=-1))
