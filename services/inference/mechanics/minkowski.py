"""The features of two convex pieces that can touch each other, found once for all small rotations of the peg.

Two convex bodies P and H touch where the origin lies on the border of P - H. That border is made of faces of P, faces
of H, and parallelograms of an edge of P and an edge of H whose arcs on the Gauss sphere (from one adjacent face normal
to the other) cross (Gregorius, "The Separating Axis Test between Convex Polyhedra", GDC 2013). A rotation by an angle
moves no normal by more than that angle, so arcs and normal cones that are farther apart can be left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.inference.mechanics.features import EDGE_ON_EDGE, PEG_CORNER_ON_FACE, PEG_FACE_ON_CORNER
from services.inference.mechanics.polyhedron import Polyhedron, arc_arc_angle

Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class CornerSupport:
    """Least height of a piece's corners over a plane, for G (normal, piece) groups of at most C corners.

    normal (G,): rows of the distinct normals; corner (C, G): rows of the distinct corners, the first one repeated where
    a group has fewer.
    """

    normal: Index
    corner: Index


@dataclass(frozen=True, slots=True, eq=False)
class FaceRows:
    """Faces of one body against pieces of the other: at most K for each of Q pairs, all (K, Q), repeats for fewer.

    group: which support; normal: which distinct normal; offset_m: of the face from its body's origin.
    """

    group: Index
    normal: Index
    offset_m: Array


@dataclass(frozen=True, slots=True, eq=False)
class EdgeRows:
    """Edge pairs whose arcs may cross: at most K for each of Q pairs, all (K, Q), repeats for fewer.

    peg_line, hole_line: which edge; hole_direction: which distinct direction the hole's edge has; hole_a, hole_b,
    peg_a, peg_b: the distinct normals of the faces beside either edge.
    """

    peg_line: Index
    hole_line: Index
    hole_direction: Index
    hole_a: Index
    hole_b: Index
    peg_a: Index
    peg_b: Index


@dataclass(frozen=True, slots=True, eq=False)
class FeatureNames:
    """The features of the rows. The K rows of a pair are hole faces first, then peg faces, then edge pairs.

    first (K, Q): number of a row's first name; its corner's place in the support is added to it. group (K, Q): which
    of the supports (the peg's, then the hole's, then one for edges). Names: kind (M,), vectors (M, 12): peg point, peg
    direction, hole point, hole direction.
    """

    first: Index
    group: Index
    kind: NDArray[np.int64]
    vectors: Array


@dataclass(frozen=True, slots=True, eq=False)
class MinkowskiFaces:
    """All data for first contacts, in distinct vectors and rows of indices; Q = P * H pairs, column p * H + h.

    peg_vectors (3, V): corners (m), then face normals, edge directions and edge moments (point x direction) of the peg
    in its frame; peg_counts: how many of the first three; peg_offsets_m of the distinct normals is in peg_faces.
    hole_corners_m, hole_normals, hole_directions (distinct, (U, 3) each) and hole_lines (J, 6): direction and
    point x direction of each edge, in the hole frame. peg_support: the peg's corners over the hole's planes;
    hole_support: the other way round.
    """

    pairs: int
    peg_vectors: Array
    peg_counts: tuple[int, int, int]
    hole_corners_m: Array
    hole_normals: Array
    hole_directions: Array
    hole_lines: Array
    peg_support: CornerSupport
    hole_support: CornerSupport
    hole_faces: FaceRows
    peg_faces: FaceRows
    edges: EdgeRows
    names: FeatureNames

    @classmethod
    def of(
        cls,
        peg: tuple[Polyhedron, ...],
        hole: tuple[Polyhedron, ...],
        peg_kept: tuple[NDArray[np.bool_], ...],
        hole_kept: tuple[NDArray[np.bool_], ...],
        cone_rad: float,
    ) -> MinkowskiFaces:
        """Prune for rotations up to cone_rad (rad). peg_kept, hole_kept: boolean (F,) per piece, the faces that can
        touch."""
        pegs = _Catalogue.of(peg, peg_kept)
        holes = _Catalogue.of(hole, hole_kept)
        hole_rows, hole_points, peg_support = _faces(holes, pegs, cone_rad, hole_first=True)
        peg_rows, peg_points, hole_support = _faces(pegs, holes, cone_rad, hole_first=False)
        edges = _edges(pegs, holes, cone_rad)
        moments = np.cross(pegs.line_points_m, pegs.line_directions)
        return cls(
            len(peg) * len(hole),
            np.vstack([pegs.corners_m, pegs.normals, pegs.line_directions, moments]),
            (len(pegs.corners_m), len(pegs.normals), len(pegs.line_directions)),
            holes.corners_m,
            holes.normals,
            holes.directions,
            np.hstack([holes.line_directions, np.cross(holes.line_points_m, holes.line_directions)]),
            peg_support,
            hole_support,
            hole_rows,
            peg_rows,
            edges,
            _names(pegs, holes, hole_rows, hole_points, peg_rows, peg_points, peg_support, hole_support, edges),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Catalogue:
    """A body's pieces with their distinct corners, normals, edge directions (and their indices per piece), and all
    edges between faces that can touch, as lines: first line of each piece, points (m) and directions."""

    pieces: tuple[Polyhedron, ...]
    kept: tuple[NDArray[np.bool_], ...]
    corners_m: Array
    corner: list[Index]
    normals: Array
    normal: list[Index]
    directions: Array
    direction: list[Index]
    lines: list[Index]
    first_line: Index
    line_points_m: Array
    line_directions: Array

    @classmethod
    def of(cls, pieces: tuple[Polyhedron, ...], kept: tuple[NDArray[np.bool_], ...]) -> _Catalogue:
        lines = [np.flatnonzero(used[solid.edge_faces].all(axis=1)) for solid, used in zip(pieces, kept, strict=True)]
        along = [solid.edge_directions[line] for solid, line in zip(pieces, lines, strict=True)]
        points = [solid.corners_m[solid.edges[line, 0]] for solid, line in zip(pieces, lines, strict=True)]
        return cls(
            pieces,
            kept,
            *_distinct([solid.corners_m for solid in pieces]),
            *_distinct([solid.normals for solid in pieces]),
            *_distinct(along),
            lines,
            np.cumsum([0] + [len(line) for line in lines]),
            np.concatenate(points),
            np.concatenate(along),
        )


def _distinct(parts: list[Array]) -> tuple[Array, list[Index]]:
    """The distinct rows (U, 3) of several arrays (k, 3), and for each array the indices of its rows among them."""
    rows, which = np.unique(np.round(np.concatenate(parts), 12) + 0.0, axis=0, return_inverse=True)
    ends = np.cumsum([len(part) for part in parts])
    return rows, np.split(np.asarray(which, dtype=np.intp).ravel(), ends[:-1])


def _stacked(columns: list[list[int]]) -> Index:
    """Lists of different length as the columns of one array (longest, columns), their first entry repeated."""
    longest = max(len(column) for column in columns)
    return np.array([column + [column[0]] * (longest - len(column)) for column in columns], dtype=np.intp).T.copy()


def _faces(
    owners: _Catalogue, others: _Catalogue, cone_rad: float, hole_first: bool
) -> tuple[FaceRows, Array, CornerSupport]:
    """The faces of owners against the corners of others, and a point on each face (K, Q, 3). hole_first: the owners are
    the hole's pieces."""
    groups: dict[tuple[int, int], int] = {}
    corners: list[list[int]] = []
    faces: list[tuple[int, float, Array]] = []
    pairs: list[list[int]] = [[] for _ in range(len(owners.pieces) * len(others.pieces))]
    of_group: list[list[int]] = [[] for _ in pairs]
    for o, (owner, kept) in enumerate(zip(owners.pieces, owners.kept, strict=True)):
        for face in np.flatnonzero(kept):
            normal = int(owners.normal[o][face])
            point = owner.corners_m[owner.on_face[:, face]][0]
            for x, other in enumerate(others.pieces):
                if (normal, x) not in groups:
                    groups[normal, x] = len(corners)
                    near = other.extreme_within(-owner.normals[face], cone_rad)
                    corners.append(others.corner[x][near].tolist())
                pair = x * len(owners.pieces) + o if hole_first else o * len(others.pieces) + x
                pairs[pair].append(len(faces))
                of_group[pair].append(groups[normal, x])
            faces.append((normal, float(owner.offsets_m[face]), point))
    row, group = _stacked(pairs), _stacked(of_group)
    return (
        FaceRows(group, np.array([face[0] for face in faces])[row], np.array([face[1] for face in faces])[row]),
        np.array([face[2] for face in faces])[row],
        CornerSupport(np.array([key[0] for key in groups]), _stacked(corners)),
    )


def _edges(pegs: _Catalogue, holes: _Catalogue, cone_rad: float) -> EdgeRows:
    """The edge pairs of every pair of pieces; the nearest pair if none is within the cone."""
    columns: list[list[list[int]]] = [[] for _ in range(7)]
    for p, (solid, lines) in enumerate(zip(pegs.pieces, pegs.lines, strict=True)):
        beside = solid.edge_faces[lines]
        a, b = -solid.normals[beside[:, 0]], -solid.normals[beside[:, 1]]
        for h, (block, edges) in enumerate(zip(holes.pieces, holes.lines, strict=True)):
            around = block.edge_faces[edges]
            c, d = block.normals[around[:, 0]], block.normals[around[:, 1]]
            angle = arc_arc_angle(a[:, None], b[:, None], c[None], d[None])
            i, j = np.nonzero(angle <= max(cone_rad + 1e-9, float(angle.min())))
            found = (
                pegs.first_line[p] + i,
                holes.first_line[h] + j,
                holes.direction[h][j],
                holes.normal[h][around[j, 0]],
                holes.normal[h][around[j, 1]],
                pegs.normal[p][beside[i, 0]],
                pegs.normal[p][beside[i, 1]],
            )
            for column, values in zip(columns, found, strict=True):
                column.append(values.tolist())
    return EdgeRows(*(_stacked(column) for column in columns))


def _names(
    pegs: _Catalogue,
    holes: _Catalogue,
    hole_rows: FaceRows,
    hole_points: Array,
    peg_rows: FaceRows,
    peg_points: Array,
    peg_support: CornerSupport,
    hole_support: CornerSupport,
    edges: EdgeRows,
) -> FeatureNames:
    """The names of all rows: a face has one for each corner of its support."""
    peg_corner = pegs.corners_m[peg_support.corner.T[hole_rows.group]]  # (K, Q, C, 3)
    hole_corner = holes.corners_m[hole_support.corner.T[peg_rows.group]]
    on_hole, on_peg = peg_corner.shape[:3], hole_corner.shape[:3]

    def spread(vectors: Array, shape: tuple[int, ...]) -> Array:
        return np.broadcast_to(vectors[:, :, None], (*shape, 3))

    hole_normal, peg_normal = holes.normals[hole_rows.normal], pegs.normals[peg_rows.normal]
    parts = [
        [peg_corner, spread(-hole_normal, on_hole), spread(hole_points, on_hole), spread(hole_normal, on_hole)],
        [spread(peg_points, on_peg), spread(peg_normal, on_peg), hole_corner, spread(-peg_normal, on_peg)],
        [
            pegs.line_points_m[edges.peg_line],
            pegs.line_directions[edges.peg_line],
            holes.line_points_m[edges.hole_line],
            holes.line_directions[edges.hole_line],
        ],
    ]
    vectors = [np.concatenate(part, axis=-1).reshape(-1, 12) for part in parts]
    sizes = [len(part) for part in vectors]
    first = [
        np.arange(rows.size).reshape(rows.shape) * count + start
        for rows, count, start in zip(
            (hole_rows.group, peg_rows.group, edges.peg_line),
            (on_hole[2], on_peg[2], 1),
            np.cumsum([0, *sizes[:2]]),
            strict=True,
        )
    ]
    group = [
        hole_rows.group,
        len(peg_support.normal) + peg_rows.group,
        np.full(edges.peg_line.shape, len(peg_support.normal) + len(hole_support.normal)),
    ]
    return FeatureNames(
        np.concatenate(first),
        np.concatenate(group),
        np.repeat(np.array([PEG_CORNER_ON_FACE, PEG_FACE_ON_CORNER, EDGE_ON_EDGE]), sizes),
        np.concatenate(vectors),
    )
