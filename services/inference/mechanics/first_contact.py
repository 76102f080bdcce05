"""First contact of the peg with the hole along a straight motion, for many poses at once.

Two convex bodies first touch where the ray of motion enters their Minkowski difference. That body is bounded by the
faces of either and by the planes of edge pairs, so the travel to contact is the largest of (separation along an axis) /
(closing speed along it) over these axes: no vertex-face or edge-edge case needs its own search (Ericson, "Real-Time
Collision Detection", 5.2 and 5.5.8).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.inference.mechanics.features import EDGE_ON_EDGE, PEG_CORNER_ON_FACE, PEG_FACE_ON_CORNER, ContactFeatures
from services.inference.mechanics.pairs import PairTables


@dataclass(frozen=True, slots=True, eq=False)
class PairContacts:
    """For N poses and Q pairs of pieces: when, and between which features, each pair first touches.

    travel_m (N, Q): signed travel along the motion to first contact (negative: already through), inf where the pair
    never meets ahead. separation_m (N, Q): largest separation over all axes, negative = penetration depth.
    features: `ContactFeatures` of shape (N, Q), meaningful where the travel is finite.
    """

    travel_m: Array
    separation_m: Array
    features: ContactFeatures


def first_contacts(
    tables: PairTables, rotation_hole_peg: Array, translation_hole_peg_m: Array, direction_hole: Array
) -> PairContacts:
    """The first contact of every pair of pieces.

    rotation_hole_peg (N, 3, 3), translation_hole_peg_m (N, 3): peg poses in the hole frame, m; direction_hole (N, 3):
    unit motion of the peg in the hole frame.
    """
    rotation = np.asarray(rotation_hole_peg, float)
    shift = np.asarray(translation_hole_peg_m, float)
    motion = np.asarray(direction_hole, float)
    n = len(rotation)
    n_peg, n_hole = len(tables.peg_corners_m), len(tables.hole_corners_m)

    def turned(vectors: Array) -> Array:
        return np.einsum("nij,pkj->npki", rotation, vectors)

    corners = turned(tables.peg_corners_m) + shift[:, None, None, :]
    peg_edges = turned(tables.peg_edges)
    n_hole_faces, n_peg_faces = tables.hole_normals.shape[1], tables.peg_normals.shape[1]
    n_peg_edges, n_hole_edges = tables.peg_edges.shape[1], tables.hole_edges.shape[1]

    # Axes in the hole frame, from hole to peg, (n, P, H, axes, 3): hole faces, peg faces, then edge pairs both ways.
    hole_axes = np.broadcast_to(tables.hole_normals[None, None], (n, n_peg, n_hole, n_hole_faces, 3))
    peg_axes = np.broadcast_to(-turned(tables.peg_normals)[:, :, None], (n, n_peg, n_hole, n_peg_faces, 3))
    crossed = np.cross(peg_edges[:, :, None, :, None, :], tables.hole_edges[None, None, :, None, :, :])
    length = np.linalg.norm(crossed, axis=-1)
    usable = (length > 1e-7).reshape(n, n_peg, n_hole, -1)
    crossed = (crossed / np.maximum(length, 1e-7)[..., None]).reshape(n, n_peg, n_hole, n_peg_edges * n_hole_edges, 3)
    axes = np.concatenate([hole_axes, peg_axes, crossed], axis=3)

    along_peg = axes @ np.swapaxes(corners, -1, -2)[:, :, None]
    along_hole = axes @ np.swapaxes(tables.hole_corners_m, -1, -2)[None, None]
    separation = along_peg.min(axis=-1) - along_hole.max(axis=-1)
    n_faces = n_hole_faces + n_peg_faces
    reverse = along_hole[..., n_faces:, :].min(axis=-1) - along_peg[..., n_faces:, :].max(axis=-1)
    closing = -np.einsum("npqai,ni->npqa", axes, motion)
    separation = np.concatenate(
        [separation[..., :n_faces], np.where(usable, separation[..., n_faces:], -np.inf), np.where(usable, reverse, -np.inf)],
        axis=-1,
    )
    closing = np.concatenate([closing, -closing[..., n_faces:]], axis=-1)

    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = separation / closing
    entering = np.where((closing > 1e-9) & np.isfinite(separation), ratio, -np.inf)
    leaving = np.where((closing < -1e-9) & np.isfinite(separation), ratio, np.inf)
    best = entering.argmax(axis=-1)
    travel = np.take_along_axis(entering, best[..., None], axis=-1)[..., 0]
    last = leaving.min(axis=-1)
    parallel_apart = np.any((np.abs(closing) <= 1e-9) & (separation > 0.0), axis=-1)
    meets = (travel <= last + 1e-9) & (last > 0.0) & ~parallel_apart & np.isfinite(travel)

    # Name the winning features: one corner on either side carries the plane, the line or the point.
    n_cross = n_peg_edges * n_hole_edges
    flipped = best >= n_faces + n_cross
    column = np.where(flipped, best - n_cross, best)
    pick = column[..., None, None]
    peg_row = np.take_along_axis(along_peg, pick, axis=3)[..., 0, :]
    hole_row = np.take_along_axis(along_hole, pick, axis=3)[..., 0, :]
    peg_corner = np.where(flipped, peg_row.argmax(axis=-1), peg_row.argmin(axis=-1))
    hole_corner = np.where(flipped, hole_row.argmin(axis=-1), hole_row.argmax(axis=-1))
    kind: NDArray[np.int64] = np.where(
        column < n_hole_faces, PEG_CORNER_ON_FACE, np.where(column < n_faces, PEG_FACE_ON_CORNER, EDGE_ON_EDGE)
    )
    p_index = np.arange(n_peg)[None, :, None]
    h_index = np.arange(n_hole)[None, None, :]
    cross_column = np.clip(column - n_faces, 0, n_cross - 1)
    peg_direction = np.where(
        (kind == EDGE_ON_EDGE)[..., None],
        tables.peg_edges[p_index, cross_column // n_hole_edges],
        tables.peg_normals[p_index, np.clip(column - n_hole_faces, 0, n_peg_faces - 1)],
    )
    hole_direction = np.where(
        (kind == EDGE_ON_EDGE)[..., None],
        tables.hole_edges[h_index, cross_column % n_hole_edges],
        tables.hole_normals[h_index, np.clip(column, 0, n_hole_faces - 1)],
    )
    shape = (n, n_peg * n_hole)
    features = ContactFeatures(
        kind.reshape(shape),
        tables.peg_corners_m[p_index, peg_corner].reshape(*shape, 3),
        peg_direction.reshape(*shape, 3),
        tables.hole_corners_m[h_index, hole_corner].reshape(*shape, 3),
        hole_direction.reshape(*shape, 3),
        np.where(flipped, -1.0, 1.0).reshape(shape),
    )
    return PairContacts(
        np.where(meets, travel, np.inf).reshape(shape), separation.max(axis=-1).reshape(shape), features
    )
