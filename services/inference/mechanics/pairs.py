"""The convex pieces of peg and hole, tabulated for the separating-axis test of every pair at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import ConvexPiece, CrossHole, CrossPeg


@dataclass(frozen=True, slots=True, eq=False)
class PairTables:
    """Corners, face normals and edge directions of the peg's P pieces (peg frame) and the hole's H pieces (hole frame).

    Pieces with fewer corners, faces or edges than the largest repeat one of theirs, which changes no maximum.
    Corners (P, V, 3) and (H, W, 3), m; normals (P, Fp, 3) and (H, Fh, 3); edge directions (P, Ep, 3) and (H, Eh, 3),
    unit.
    """

    peg_corners_m: Array
    peg_normals: Array
    peg_edges: Array
    hole_corners_m: Array
    hole_normals: Array
    hole_edges: Array

    @classmethod
    def of(cls, peg: CrossPeg, hole: CrossHole) -> PairTables:
        """The tables of a peg and a hole. The plate's sides and back are left out: the peg does not reach them."""
        peg_pieces, hole_pieces = peg.pieces(), hole.pieces()
        plate = hole.plate_half_size_m

        def faces_the_peg(normal: Array, offset: float) -> bool:
            return bool(abs(offset - plate) > 1e-9 and normal[2] < 0.5)

        return cls(
            _padded([piece.vertices_m() for piece in peg_pieces]),
            _padded([piece.normals[piece.normals[:, 2] > -0.5] for piece in peg_pieces]),
            _padded([_edge_directions(piece, np.inf) for piece in peg_pieces]),
            _padded([piece.vertices_m() for piece in hole_pieces]),
            _padded(
                [
                    np.array([n for n, o in zip(piece.normals, piece.offsets_m, strict=True) if faces_the_peg(n, o)])
                    for piece in hole_pieces
                ]
            ),
            _padded([_edge_directions(piece, plate) for piece in hole_pieces]),
        )


def _edge_directions(piece: ConvexPiece, plate_half_size_m: float) -> Array:
    """The distinct directions (k, 3) of a piece's edges: lines on which two faces meet in at least two corners.

    Edges on the sides of the plate are left out.
    """
    corners = piece.vertices_m()
    on_face = np.abs(corners @ piece.normals.T - piece.offsets_m) < 1e-9
    directions: list[Array] = []
    for i in range(len(corners)):
        for j in range(i + 1, len(corners)):
            on_side = np.abs(np.abs([corners[i, :2], corners[j, :2]]) - plate_half_size_m) < 1e-9
            if np.any(on_side.all(axis=0)):
                continue
            if np.count_nonzero(on_face[i] & on_face[j]) >= 2:
                direction = corners[j] - corners[i]
                direction = direction / np.linalg.norm(direction)
                if not any(np.linalg.norm(np.cross(direction, known)) < 1e-9 for known in directions):
                    directions.append(direction)
    return np.array(directions)


def _padded(rows: list[Array]) -> Array:
    """Stack arrays (k_i, 3) to (n, max k, 3), repeating each one's first row."""
    longest = max(len(row) for row in rows)
    return np.array([np.vstack([row, np.repeat(row[:1], longest - len(row), axis=0)]) for row in rows])
