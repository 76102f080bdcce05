"""First contact by separating axes, the plain method: every axis of every pair of pieces, none left out.

The travel to contact of two convex pieces is the largest of (separation along an axis) / (closing speed along it) over
the face normals of either and the cross products of their edges (Ericson, "Real-Time Collision Detection", 5.2 and
5.5.8). `first_contact` does the same on the few axes that matter; tests and the benchmark compare it with this module.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.inference.mechanics.features import EDGE_ON_EDGE, PEG_CORNER_ON_FACE, PEG_FACE_ON_CORNER, ContactFeatures
from services.inference.mechanics.first_contact import PairContacts
from services.inference.mechanics.pairs import PairTables
from services.inference.mechanics.polyhedron import Polyhedron


@dataclass(frozen=True, slots=True, eq=False)
class AxisTables:
    """Corners, face normals and edge directions of the peg's P pieces (peg frame) and the hole's H pieces (hole frame).

    Pieces with fewer corners, faces or edges than the largest repeat one of their own, which changes no maximum.
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
    def of(cls, tables: PairTables) -> AxisTables:
        """The same pieces, with all their features."""
        return cls(
            _padded([solid.corners_m for solid in tables.peg]),
            _padded([solid.normals for solid in tables.peg]),
            _padded([_edge_directions(solid) for solid in tables.peg]),
            _padded([solid.corners_m for solid in tables.hole]),
            _padded([solid.normals for solid in tables.hole]),
            _padded([_edge_directions(solid) for solid in tables.hole]),
        )


def _edge_directions(solid: Polyhedron) -> Array:
    """The distinct directions (k, 3) of a piece's edges."""
    directions: list[Array] = []
    for direction in solid.edge_directions:
        if not any(np.linalg.norm(np.cross(direction, known)) < 1e-9 for known in directions):
            directions.append(direction)
    return np.array(directions)


def _padded(rows: list[Array]) -> Array:
    """Stack arrays (k_i, 3) to (n, max k, 3), repeating each one's first row."""
    longest = max(len(row) for row in rows)
    return np.array([np.vstack([row, np.repeat(row[:1], longest - len(row), axis=0)]) for row in rows])


def first_contacts_by_axes(
    tables: AxisTables, rotation_hole_peg: Array, translation_hole_peg_m: Array, direction_hole: Array
) -> PairContacts:
    """As `first_contacts`, arguments and result alike; arrays inside keep the poses on their last axis."""
    rotation = np.asarray(rotation_hole_peg, float)
    shift = np.ascontiguousarray(np.asarray(translation_hole_peg_m, float).T)
    motion = np.ascontiguousarray(np.asarray(direction_hole, float).T)
    to_hole = np.ascontiguousarray(rotation.transpose(1, 2, 0))
    separation, closing = _separations(tables, to_hole, shift, motion)

    finite = separation > -1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = separation / closing
    entering = np.where((closing > 1e-9) & finite, ratio, -np.inf)
    best = entering.argmax(axis=0)
    travel = np.take_along_axis(entering, best[None], axis=0)[0]
    last = np.where((closing < -1e-9) & finite, ratio, np.inf).min(axis=0)
    parallel_apart = ((np.abs(closing) <= 1e-9) & (separation > 0.0)).any(axis=0)
    meets = (travel <= last + 1e-9) & (last > 0.0) & ~parallel_apart & np.isfinite(travel)
    return PairContacts(
        np.where(meets, travel, np.inf).T, separation.max(axis=0).T, _name_features(tables, rotation, best.T)
    )


def _separations(tables: AxisTables, to_hole: Array, shift: Array, motion: Array) -> tuple[Array, Array]:
    """Separation (m) and closing speed along every axis (A, P * H, N), for rotations (3, 3, N) and shifts (3, N)."""
    n = shift.shape[1]
    pegs, corners, _ = tables.peg_corners_m.shape
    holes, hole_corners, _ = tables.hole_corners_m.shape
    hole_edges, peg_edges = tables.hole_edges.shape[1], tables.peg_edges.shape[1]

    def spread(values: Array) -> Array:
        return np.broadcast_to(values, (values.shape[0], pegs, holes, n)).reshape(values.shape[0], pegs * holes, n)

    # Hole faces: the peg's support along the few distinct normals.
    normals, which = _distinct(tables.hole_normals)
    offsets = np.einsum("hfi,hwi->hfw", tables.hole_normals, tables.hole_corners_m).max(axis=-1)
    normals_peg = np.einsum("ui,ijn->jun", normals, to_hole).reshape(3, -1)
    support = (tables.peg_corners_m.transpose(1, 0, 2).reshape(-1, 3) @ normals_peg).reshape(corners, pegs, -1, n)
    reach = support.min(axis=0) + normals @ shift
    hole_separation = (reach[:, which] - offsets[None, :, :, None]).transpose(2, 0, 1, 3)
    hole_closing = -(normals @ motion)[which].transpose(1, 0, 2)[:, None]

    # Peg faces: the hole blocks' support along each turned normal.
    peg_normals = np.einsum("pfj,ijn->ifpn", tables.peg_normals, to_hole)
    peg_offsets = np.einsum("pfi,pvi->pfv", tables.peg_normals, tables.peg_corners_m).max(axis=-1)
    support = (tables.hole_corners_m.transpose(1, 0, 2).reshape(-1, 3) @ peg_normals.reshape(3, -1)).reshape(
        hole_corners, holes, -1, pegs, n
    )
    own = np.einsum("ifpn,in->fpn", peg_normals, shift) + peg_offsets.T[:, :, None]
    peg_separation = support.min(axis=0).transpose(1, 2, 0, 3) - own[:, :, None]
    peg_closing = np.einsum("ifpn,in->fpn", peg_normals, motion)[:, :, None]

    # Edge pairs, (peg edge x hole edge) and its opposite: n . b = peg edge . (hole edge x b), and the like for the peg.
    edges, which = _distinct(tables.hole_edges)
    turned = np.einsum("pej,ijn->iepn", tables.peg_edges, to_hole)
    arms = np.cross(tables.hole_edges[:, :, None], tables.hole_corners_m[:, None]).transpose(2, 1, 0, 3)
    on_hole = (arms.reshape(-1, 3) @ turned.reshape(3, -1)).reshape(hole_corners, hole_edges, holes, peg_edges, pegs, n)
    hole_low, hole_high = (x.transpose(2, 0, 3, 1, 4) for x in (on_hole.min(axis=0), on_hole.max(axis=0)))
    edges_peg = np.einsum("ui,ijn->jun", edges, to_hole).reshape(3, -1)
    arms = np.cross(tables.peg_corners_m[:, None], tables.peg_edges[:, :, None]).transpose(2, 1, 0, 3)
    on_peg = (arms.reshape(-1, 3) @ edges_peg).reshape(corners, peg_edges, pegs, -1, n)
    axes = np.stack(
        [
            turned[(i + 1) % 3][:, :, None] * edges[None, None, :, (i + 2) % 3, None]
            - turned[(i + 2) % 3][:, :, None] * edges[None, None, :, (i + 1) % 3, None]
            for i in range(3)
        ]
    )
    length = np.sqrt((axes * axes).sum(axis=0))
    scale = 1.0 / np.maximum(length, 1e-7)
    own = np.einsum("iepun,in->epun", axes, shift)

    def per_block(values: Array) -> Array:
        """(E, P, U, N) to (E, Eh, P, H, N)."""
        return values[:, :, which].transpose(0, 3, 1, 2, 4)

    factor = per_block(scale)
    forth = (per_block(on_peg.min(axis=0) + own) - hole_high) * factor
    back = (hole_low - per_block(on_peg.max(axis=0) + own)) * factor
    dead = per_block(np.where(length > 1e-7, 0.0, 1.0)) > 0.5
    forth[dead], back[dead] = -np.inf, -np.inf
    edge_closing = per_block(-np.einsum("iepun,in->epun", axes, motion) * scale)
    crossed = (-1, pegs * holes, n)
    separation = [
        spread(hole_separation), spread(peg_separation), forth.reshape(crossed), back.reshape(crossed),
    ]  # fmt: skip
    closing = [
        spread(hole_closing), spread(peg_closing), edge_closing.reshape(crossed), -edge_closing.reshape(crossed),
    ]  # fmt: skip
    return np.concatenate(separation), np.concatenate(closing)


def _distinct(vectors: Array) -> tuple[Array, NDArray[np.intp]]:
    """The distinct rows (U, 3) of vectors (H, F, 3), and which of them each is (H, F)."""
    rows, which = np.unique(np.round(vectors.reshape(-1, 3), 12), axis=0, return_inverse=True)
    return rows, np.asarray(which, dtype=np.intp).reshape(vectors.shape[:-1])


def _name_features(tables: AxisTables, rotation: Array, best: Array) -> ContactFeatures:
    """The features behind the winning axes best (N, P * H): on either side one corner and a direction."""
    n = len(rotation)
    pegs, holes = len(tables.peg_corners_m), len(tables.hole_corners_m)
    hole_faces, peg_faces = tables.hole_normals.shape[1], tables.peg_normals.shape[1]
    hole_edges = tables.hole_edges.shape[1]
    n_cross = tables.peg_edges.shape[1] * hole_edges
    n_faces = hole_faces + peg_faces
    flipped = best >= n_faces + n_cross
    column = np.where(flipped, best - n_cross, best)
    kind = np.where(
        column < hole_faces, PEG_CORNER_ON_FACE, np.where(column < n_faces, PEG_FACE_ON_CORNER, EDGE_ON_EDGE)
    )
    p_index = np.repeat(np.arange(pegs), holes)[None]
    h_index = np.tile(np.arange(holes), pegs)[None]
    cross_column = np.clip(column - n_faces, 0, n_cross - 1)
    is_edge = (kind == EDGE_ON_EDGE)[..., None]
    peg_direction = np.where(
        is_edge,
        tables.peg_edges[p_index, cross_column // hole_edges],
        tables.peg_normals[p_index, np.clip(column - hole_faces, 0, peg_faces - 1)],
    )
    hole_direction = np.where(
        is_edge,
        tables.hole_edges[h_index, cross_column % hole_edges],
        tables.hole_normals[h_index, np.clip(column, 0, hole_faces - 1)],
    )
    sign = np.where(flipped, -1.0, 1.0)
    hole_in_peg = np.einsum("nji,nqj->nqi", rotation, hole_direction)
    normal_peg = np.where(
        is_edge,
        np.cross(peg_direction, hole_in_peg) * sign[..., None],
        np.where((kind == PEG_CORNER_ON_FACE)[..., None], hole_in_peg, -peg_direction),
    )
    normal_hole = np.einsum("nij,nqj->nqi", rotation, normal_peg)
    along_peg = np.einsum("qvi,nqi->nqv", tables.peg_corners_m[p_index[0]], normal_peg)
    along_hole = np.einsum("qvi,nqi->nqv", tables.hole_corners_m[h_index[0]], normal_hole)
    return ContactFeatures(
        np.broadcast_to(kind, (n, pegs * holes)),
        tables.peg_corners_m[p_index, along_peg.argmin(axis=-1)],
        peg_direction,
        tables.hole_corners_m[h_index, along_hole.argmax(axis=-1)],
        hole_direction,
        sign,
    )
