"""First contact of the peg with the hole along a straight motion, for many poses at once.

Two convex pieces first touch where the ray of motion enters their Minkowski difference: at the largest of (separation
along a face's normal) / (closing speed along it) over the faces of that body, which `minkowski` lists. So the
vertex-face and edge-edge cases need no separate search (Ericson, "Real-Time Collision Detection", 5.3.8 and 5.5.8).

Arrays inside are (row of a pair, pair, pose), and poses are processed in portions that stay in the cache. Rows that do
not count are multiplied by 0 after all others were made positive: a masked copy is ten times slower.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.inference.mechanics.features import ContactFeatures
from services.inference.mechanics.minkowski import CornerSupport, FaceRows, MinkowskiFaces
from services.inference.mechanics.pairs import CONES_RAD, PairTables

# Table entries that stay in the second-level cache; the least and the most poses per portion.
PORTION = 100_000
FEWEST, MAX_ = 8, 512
# Added to travels and separations to make them positive, at a rounding error of 2^-50 m; also their upper limit.
FAR_M = 4.0
PARALLEL = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class PairContacts:
    """For N poses and Q pairs of pieces: the travel and the features of each pair's first contact.

    travel_m (N, Q): signed travel along the motion to first contact (negative: already through), inf where the pair
    never meets ahead. separation_m (N, Q): largest separation over all faces of the Minkowski difference, negative =
    penetration depth. features: `ContactFeatures` of shape (N, Q), meaningful where the travel is finite.
    """

    travel_m: Array
    separation_m: Array
    features: ContactFeatures


@dataclass(frozen=True, slots=True, eq=False)
class FirstContacts:
    """For N poses: travel_m (N,) to the first contact of all, inf where there is none; its pair (N,) of pieces, column
    p * H + h; its features, of shape (N,)."""

    travel_m: Array
    pair: NDArray[np.intp]
    features: ContactFeatures


def first_contacts(
    tables: PairTables, rotation_hole_peg: Array, translation_hole_peg_m: Array, direction_hole: Array
) -> PairContacts:
    """The first contact of every pair of pieces.

    rotation_hole_peg (N, 3, 3), translation_hole_peg_m (N, 3): peg poses in the hole frame, m; direction_hole (N, 3):
    unit motion of the peg in the hole frame.
    """
    n, pairs = len(rotation_hole_peg), tables.shape[0] * tables.shape[1]
    travel, separation, sign = np.empty((n, pairs)), np.empty((n, pairs)), np.empty((n, pairs))
    kind, vectors = np.empty((n, pairs), dtype=np.int64), np.empty((n, pairs, 12))
    for part, faces, swept in _portions(tables, rotation_hole_peg, translation_hole_peg_m, direction_hole, True):
        travel[part], separation[part], sign[part] = swept.travel_m.T, swept.separation_m.T, swept.sign.T
        name = swept.name.T
        kind[part], vectors[part] = faces.names.kind[name], faces.names.vectors[name]
    return PairContacts(travel, separation, _features(kind, vectors, sign))


def first_contact(
    tables: PairTables, rotation_hole_peg: Array, translation_hole_peg_m: Array, direction_hole: Array
) -> FirstContacts:
    """The first contact of all pairs of pieces, for poses and motions as in `first_contacts`; a third faster."""
    n = len(rotation_hole_peg)
    travel, sign, pair = np.empty(n), np.empty(n), np.empty(n, dtype=np.intp)
    kind, vectors = np.empty(n, dtype=np.int64), np.empty((n, 12))
    for part, faces, swept in _portions(tables, rotation_hole_peg, translation_hole_peg_m, direction_hole, False):
        first = swept.travel_m.argmin(axis=0)
        column = np.arange(len(first))
        travel[part], sign[part], pair[part] = swept.travel_m[first, column], swept.sign[first, column], first
        name = swept.name[first, column]
        kind[part], vectors[part] = faces.names.kind[name], faces.names.vectors[name]
    return FirstContacts(travel, pair, _features(kind, vectors, sign))


def _features(kind: NDArray[np.int64], vectors: Array, sign: Array) -> ContactFeatures:
    return ContactFeatures(kind, vectors[..., 0:3], vectors[..., 3:6], vectors[..., 6:9], vectors[..., 9:12], sign)


@dataclass(frozen=True, slots=True, eq=False)
class _Swept:
    """First contacts of n poses, (Q, n) each: travel, separation (zeros if not asked for), name and sign."""

    travel_m: Array
    separation_m: Array
    name: NDArray[np.intp]
    sign: Array


def _portions(
    tables: PairTables,
    rotation_hole_peg: Array,
    translation_hole_peg_m: Array,
    direction_hole: Array,
    separations: bool,
) -> Iterator[tuple[NDArray[np.intp] | slice, MinkowskiFaces, _Swept]]:
    """The poses portion by portion: their rows, the tables valid for them, their first contacts."""
    rotation = np.asarray(rotation_hole_peg, float)
    translation = np.asarray(translation_hole_peg_m, float)
    direction = np.asarray(direction_hole, float)
    n = len(rotation)
    turned = np.arccos(np.clip((np.einsum("nii->n", rotation) - 1.0) / 2.0, -1.0, 1.0))
    level = np.searchsorted(np.array(CONES_RAD[:-1]), turned)
    for which in np.unique(level):
        faces = tables.faces_within(CONES_RAD[which])
        rows = np.flatnonzero(level == which)
        portion = int(np.clip(PORTION // faces.edges.peg_line.size, FEWEST, MAX_))
        for start in range(0, len(rows), portion):
            # A slice avoids copies if all poses are in one group.
            part: NDArray[np.intp] | slice = rows[start : start + portion]
            if len(rows) == n:
                part = slice(start, min(start + portion, n))
            yield part, faces, _sweep(faces, rotation[part], translation[part], direction[part], separations)


def _sweep(faces: MinkowskiFaces, rotation: Array, translation: Array, direction: Array, separations: bool) -> _Swept:
    """First contacts of n poses."""
    turn = np.ascontiguousarray(rotation.transpose(1, 2, 0))
    shift = np.ascontiguousarray(translation.T)
    motion = np.ascontiguousarray(direction.T)
    corners, normals, edges, moments = np.split(faces.peg_vectors @ turn, np.cumsum(faces.peg_counts), axis=1)
    corners = corners + shift[:, None]
    # A moment about the hole's origin: (R p + t) x R e.
    moments = moments + _cross(shift[:, None], edges)

    hole_reach, hole_corner = _reach(faces.hole_normals, faces.peg_support, corners)
    peg_reach, peg_corner = _reach_back(faces.hole_corners_m, faces.hole_support, normals)
    own = _along(normals, shift)
    bounds = [
        _face_bounds(faces.hole_faces, hole_reach, None, -(faces.hole_normals @ motion), separations),
        _face_bounds(faces.peg_faces, peg_reach, own, _along(normals, motion), separations),
    ]
    edge_bounds, forth = _edge_bounds(faces, normals, edges, moments, motion, separations)
    bounds.append(edge_bounds)

    entering, row = bounds[0].entering, bounds[0].row.astype(np.intp)
    first_row = bounds[0].rows
    for after in bounds[1:]:
        row = np.where(after.entering > entering, after.row.astype(np.intp) + first_row, row)
        entering = np.maximum(entering, after.entering)
        first_row += after.rows
    first_row -= bounds[-1].rows
    leaving = np.minimum(np.minimum(bounds[0].leaving, bounds[1].leaving), bounds[2].leaving)
    apart = np.maximum(np.maximum(bounds[0].apart, bounds[1].apart), bounds[2].apart)
    meets = (entering <= leaving + 1e-9) & (leaving > 0.0) & (np.abs(entering) < 0.99 * FAR_M)

    # Names and signs, by flat indices into (group, pose) and (row, pair, pose).
    n, q = len(rotation), faces.pairs
    pose, pair = np.arange(n), np.arange(q)[:, None]
    place = row * q + pair
    corner = np.concatenate([hole_corner, peg_corner, np.zeros((1, n), dtype=np.uint8)])
    name = faces.names.first.take(place) + corner.take(faces.names.group.take(place) * n + pose)
    edge_row = np.maximum(row - first_row, 0)
    sign = np.where(forth.take((edge_row * q + pair) * n + pose), 1.0, -1.0)
    return _Swept(np.where(meets, entering, np.inf), apart, name, sign)


def _cross(a: Array, b: Array) -> Array:
    """Cross product of vectors on the first axis, (3, ...)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _along(vectors: Array, direction: Array) -> Array:
    """Dot products (U, n) of vectors (3, U, n) with directions (3, n)."""
    return np.asarray(vectors[0] * direction[0] + vectors[1] * direction[1] + vectors[2] * direction[2])


def _dots(vectors: Array, others: Array) -> Array:
    """Dot products of vectors (U, d) with others (d, W, n), as rows (U * W, n)."""
    return np.asarray((vectors @ others.reshape(vectors.shape[1], -1)).reshape(-1, others.shape[2]))


def _least(rows: Array) -> tuple[Array, NDArray[np.uint8]]:
    """The minimum of rows (C, G, n), and the last row that attains it, (G, n)."""
    least = rows.min(axis=0)
    return least, _last_equal(rows, least)


def _last_equal(rows: Array, value: Array) -> NDArray[np.uint8]:
    """The last row of (K, ..., n) that equals value (..., n)."""
    small = np.uint8 if len(rows) <= 256 else np.uint16
    number = np.arange(len(rows), dtype=small).reshape(-1, *(1,) * value.ndim)
    return np.asarray(((rows == value).view(np.uint8) * number).max(axis=0))


def _reach(hole_normals: Array, support: CornerSupport, corners: Array) -> tuple[Array, NDArray[np.uint8]]:
    """Least height (G, n) of the peg's pieces over planes of the hole through its origin, and the corner that attains
    it."""
    dots = _dots(hole_normals, corners)
    return _least(dots.take(support.normal * corners.shape[1] + support.corner, axis=0))


def _reach_back(hole_corners: Array, support: CornerSupport, normals: Array) -> tuple[Array, NDArray[np.uint8]]:
    """Least height (G, n) of the hole's pieces over planes of the peg through its origin, and the corner that attains
    it."""
    dots = _dots(hole_corners, normals)
    return _least(dots.take(support.corner * normals.shape[1] + support.normal, axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class _Bounds:
    """Over K rows of each pair, (Q, n): largest separation, last entering travel and its row, first leaving travel."""

    rows: int
    apart: Array
    entering: Array
    row: NDArray[np.uint8]
    leaving: Array


def _bounds(ratio: Array, enters: NDArray[np.bool_], leaves: NDArray[np.bool_], apart: Array) -> _Bounds:
    """Bounds from travels (K, Q, n) at which faces are crossed, into the body and out of it. Overwrites the travels."""
    inward = ratio + FAR_M
    inward *= enters
    last = inward.max(axis=0)
    np.subtract(FAR_M, ratio, out=ratio)
    ratio *= leaves
    return _Bounds(len(inward), apart, last - FAR_M, _last_equal(inward, last), FAR_M - ratio.max(axis=0))


def _face_bounds(rows: FaceRows, reach: Array, own: Array | None, closing: Array, separations: bool) -> _Bounds:
    """Bounds from the faces of one body; closing (U, n): closing speed along each distinct normal."""
    # For motion along a face, it must still be decided whether it passes in front of the face or behind it.
    slow = np.abs(closing) < PARALLEL
    inverse = 1.0 / np.where(slow, PARALLEL, closing)
    apart = reach.take(rows.group, axis=0)
    apart -= rows.offset_m[..., None]
    if own is not None:
        apart -= own.take(rows.normal, axis=0)
    ratio = apart * inverse.take(rows.normal, axis=0)
    enters = (inverse > 0.0).take(rows.normal, axis=0)
    largest = apart.max(axis=0) if separations else reach[:0]
    return _bounds(ratio, enters, ~enters, largest)


def _edge_bounds(
    faces: MinkowskiFaces, normals: Array, edges: Array, moments: Array, motion: Array, separations: bool
) -> tuple[_Bounds, NDArray[np.bool_]]:
    """Bounds from edge pairs where their arcs cross, and (K, Q, n) whether peg edge x hole edge points from hole to peg
    (else it is the opposite)."""
    rows = faces.edges
    lines = edges.shape[1]
    # The side of the peg edges' planes on which the hole's normals lie, and vice versa: arcs cross if the ends of each
    # lie on both sides of the other, in the same hemisphere.
    beyond_peg = _dots(faces.hole_normals, edges) > 0.0
    beyond_hole = _dots(faces.hole_directions, normals) > 0.0
    of_normal = rows.hole_direction * normals.shape[1]
    forth = beyond_peg.take(rows.hole_a * lines + rows.peg_line, axis=0)
    b = beyond_hole.take(of_normal + rows.peg_b, axis=0)
    crossing = forth ^ b
    crossing &= forth ^ beyond_peg.take(rows.hole_b * lines + rows.peg_line, axis=0)
    crossing &= b ^ beyond_hole.take(of_normal + rows.peg_a, axis=0)

    # Travel = -[hole edge, peg edge, between] / [hole edge, peg edge, motion]: the normal's length cancels.
    on_edge = rows.hole_direction * lines + rows.peg_line
    speed = _dots(faces.hole_directions, _cross(motion[:, None], edges))
    slow = np.abs(speed) < PARALLEL
    inverse = -1.0 / np.where(slow, -PARALLEL, speed)
    volume = _dots(faces.hole_lines, np.concatenate([moments, edges])).take(
        rows.hole_line * lines + rows.peg_line, axis=0
    )
    ratio = volume * inverse.take(on_edge, axis=0)
    enters = (inverse > 0.0).take(on_edge, axis=0)
    enters ^= ~forth
    leaves = crossing & ~enters
    enters &= crossing
    largest = volume[0, :0]
    if separations:
        cosine = _dots(faces.hole_directions, edges)
        scale = 1.0 / np.sqrt(np.maximum(1.0 - cosine * cosine, 1e-12))
        volume *= scale.take(on_edge, axis=0)
        volume *= np.where(forth, 1.0, -1.0)
        volume += FAR_M
        volume *= crossing
        largest = volume.max(axis=0) - FAR_M
    return _bounds(ratio, enters, leaves, largest), forth
