"""First contact of the peg with the hole along a straight motion, for many poses at once.

Two convex pieces first touch where the ray of motion enters their Minkowski difference: at the largest of (separation
along a face's normal) / (closing speed along it) over the faces of that body, which `minkowski` lists. So no vertex-face
or edge-edge case needs its own search (Ericson, "Real-Time Collision Detection", 5.3.8 and 5.5.8).

Arrays inside keep the poses on their last axis, so that every operation runs over contiguous memory, and poses are
taken in portions that stay in the cache. Which row of a table won a reduction is carried in the lowest bits of the
reduced numbers, which spares a search; it costs them 2^-38 of their value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.inference.mechanics.features import EDGE_ON_EDGE, PEG_CORNER_ON_FACE, PEG_FACE_ON_CORNER, ContactFeatures
from services.inference.mechanics.minkowski import CornerSupport, FaceRows, MinkowskiFaces
from services.inference.mechanics.pairs import CONES_RAD, PairTables

# Numbers of a table that stay in the second-level cache, and the least and the most poses a portion.
PORTION = 60_000
FEWEST, MOST = 8, 512
TAG_BITS = 14
_TAG = np.int64((1 << TAG_BITS) - 1)
FAR_M = 1e6
PARALLEL = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class PairContacts:
    """For N poses and Q pairs of pieces: when, and between which features, each pair first touches.

    travel_m (N, Q): signed travel along the motion to first contact (negative: already through), inf where the pair
    never meets ahead. separation_m (N, Q): largest separation over all faces of the Minkowski difference, negative =
    penetration depth. features: `ContactFeatures` of shape (N, Q), meaningful where the travel is finite.
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
    translation = np.asarray(translation_hole_peg_m, float)
    direction = np.asarray(direction_hole, float)
    n, (pegs, holes) = len(rotation), tables.shape
    pairs = pegs * holes
    travel, separation = np.empty((n, pairs)), np.empty((n, pairs))
    features = _empty_features((n, pairs))
    turned = np.arccos(np.clip((np.einsum("nii->n", rotation) - 1.0) / 2.0, -1.0, 1.0))
    level = np.searchsorted(np.array(CONES_RAD[:-1]), turned)
    for which in np.unique(level):
        faces = tables.faces_within(CONES_RAD[which])
        rows = np.flatnonzero(level == which)
        portion = int(np.clip(PORTION // len(faces.edges.pair), FEWEST, MOST))
        for start in range(0, len(rows), portion):
            # A slice where all poses are alike spares copies.
            part: NDArray[np.intp] | slice = rows[start : start + portion]
            if len(rows) == n:
                part = slice(start, min(start + portion, n))
            _portion(
                faces, rotation[part], translation[part], direction[part], part, travel, separation, features
            )
    return PairContacts(travel, separation, features)


def _empty_features(shape: tuple[int, ...]) -> ContactFeatures:
    vectors = [np.empty((*shape, 3)) for _ in range(4)]
    return ContactFeatures(np.empty(shape, dtype=np.int64), *vectors, np.empty(shape))


def _portion(
    faces: MinkowskiFaces,
    rotation: Array,
    translation: Array,
    direction: Array,
    part: NDArray[np.intp] | slice,
    travel: Array,
    separation: Array,
    features: ContactFeatures,
) -> None:
    """First contacts of some poses, written into rows `part` of travel, separation and features."""
    n = len(rotation)
    turn = np.ascontiguousarray(rotation.transpose(1, 2, 0))
    shift = np.ascontiguousarray(translation.T)
    motion = np.ascontiguousarray(direction.T)
    counts = [len(faces.peg_corners_m), len(faces.peg_normals), len(faces.peg_directions)]
    moments = np.cross(faces.peg_points_m, faces.peg_directions)
    everything = np.vstack([faces.peg_corners_m, faces.peg_normals, faces.peg_directions, moments])
    corners, normals, edges, moment = np.split(everything @ turn, np.cumsum(counts), axis=1)
    corners = corners + shift[:, None]
    moment = moment + _cross(shift[:, None], edges)

    names = faces.names
    hole_reach = _reach(faces.peg_support, faces.hole_normals, corners)
    peg_reach = _reach_back(faces.hole_support, faces.hole_corners_m, normals)
    own = np.einsum("ifn,in->fn", normals, shift)
    found = [
        _face_bounds(faces.hole_faces, hole_reach, None, -(faces.hole_normals @ motion), 0),
        _face_bounds(
            faces.peg_faces, peg_reach, own, np.einsum("ifn,in->fn", normals, motion), names.peg_faces_from
        ),
        _edge_bounds(faces, normals, edges, moment, motion),
    ]
    apart = np.maximum(np.maximum(found[0][0], found[1][0]), found[2][0])
    entering = np.maximum(np.maximum(found[0][1], found[1][1]), found[2][1])
    leaving = np.minimum(np.minimum(found[0][2], found[1][2]), found[2][2])
    tag = entering.view(np.int64) & _TAG
    meets = (entering <= leaving + 1e-9) & (leaving > 0.0) & (entering > -FAR_M) & (entering < FAR_M)
    travel[part] = np.where(meets, entering, np.inf).T
    separation[part] = apart.T
    _name(faces, tag, np.concatenate([hole_reach, peg_reach]), turn, motion, part, features)
    assert n == tag.shape[1]


def _cross(a: Array, b: Array) -> Array:
    """a x b for vectors on the first axis, (3, ...)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _tagged(values: Array, tags: NDArray[np.int64]) -> Array:
    """Values (L, n) with the tags (L,) put, in place, into their lowest bits."""
    bits = values.view(np.int64)
    bits &= ~_TAG
    bits |= tags[:, None]
    return values


def _local(start: NDArray[np.intp], rows: int) -> NDArray[np.int64]:
    """The number of each row within its group, for groups that start at `start`."""
    sizes = np.diff(np.append(start, rows))
    return (np.arange(rows) - np.repeat(start, sizes)).astype(np.int64)


def _reach(support: CornerSupport, hole_normals: Array, corners: Array) -> Array:
    """Least height (G, n) of the peg's pieces over planes of the hole through its origin, tagged with the corner."""
    n = corners.shape[2]
    dots = (hole_normals @ corners.reshape(3, -1)).reshape(-1, n)
    rows = dots.take(support.normal * corners.shape[1] + support.corner, axis=0)
    return np.asarray(
        np.minimum.reduceat(_tagged(rows, _local(support.start, len(rows))), support.start, axis=0)
    )


def _reach_back(support: CornerSupport, hole_corners: Array, normals: Array) -> Array:
    """Least height (G, n) of the hole's pieces over planes of the peg through its origin, tagged with the corner."""
    n = normals.shape[2]
    dots = (hole_corners @ normals.reshape(3, -1)).reshape(-1, n)
    rows = dots.take(support.corner * normals.shape[1] + support.normal, axis=0)
    return np.asarray(
        np.minimum.reduceat(_tagged(rows, _local(support.start, len(rows))), support.start, axis=0)
    )


def _bounds(
    ratio: Array, apart: Array, closing: Array, start: NDArray[np.intp], tags: NDArray[np.int64]
) -> tuple[Array, Array, Array]:
    """Of rows (L, n), for each pair (Q, n): largest separation, last entering travel (tagged), first leaving travel."""
    enters = np.where(closing > PARALLEL, ratio, np.where((closing >= -PARALLEL) & (apart > 0.0), FAR_M, -FAR_M))
    leaves = np.where(closing < -PARALLEL, ratio, FAR_M)
    return (
        np.maximum.reduceat(apart, start, axis=0),
        np.maximum.reduceat(_tagged(enters, tags), start, axis=0),
        np.minimum.reduceat(leaves, start, axis=0),
    )


def _face_bounds(
    rows: FaceRows, reach: Array, own: Array | None, closing: Array, tags_from: int
) -> tuple[Array, Array, Array]:
    """Bounds from the faces of one body."""
    apart = reach.take(rows.group, axis=0)
    apart -= rows.offset_m[:, None]
    if own is not None:
        apart -= own.take(rows.normal, axis=0)
    speed = closing.take(rows.normal, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = apart / speed
    return _bounds(ratio, apart, speed, rows.start, _local(rows.start, len(apart)) + tags_from)


def _edge_bounds(
    faces: MinkowskiFaces, normals: Array, edges: Array, moment: Array, motion: Array
) -> tuple[Array, Array, Array]:
    """Bounds from edge pairs, (peg edge x hole edge) either way round, where their arcs cross."""
    rows = faces.edges
    _, lines, n = edges.shape
    directions = faces.hole_edge_directions

    def dots(vectors: Array, others: Array) -> Array:
        return np.asarray((vectors @ others.reshape(vectors.shape[1], -1)).reshape(-1, n))

    beyond_peg = dots(faces.hole_normals, edges) > 0.0
    beyond_hole = dots(directions, normals) > 0.0
    on_edge = rows.hole_direction * lines + rows.peg_line
    on_normal = rows.hole_direction * normals.shape[1]
    c = beyond_peg.take(rows.hole_a * lines + rows.peg_line, axis=0)
    d = beyond_peg.take(rows.hole_b * lines + rows.peg_line, axis=0)
    a = beyond_hole.take(on_normal + rows.peg_a, axis=0)
    b = beyond_hole.take(on_normal + rows.peg_b, axis=0)
    crossing = (c ^ d) & (a ^ b) & (c ^ b)

    cosine = dots(directions, edges)
    square = 1.0 - cosine * cosine
    scale = np.where(square > 1e-12, 1.0 / np.sqrt(np.maximum(square, 1e-12)), 0.0)
    speed = -dots(directions, _cross(motion[:, None], edges)) * scale
    twelve = np.concatenate([faces.hole_directions, np.cross(faces.hole_points_m, faces.hole_directions)], axis=1)
    volume = dots(twelve, np.concatenate([moment, edges]))

    scale = scale.take(on_edge, axis=0)
    crossing &= scale > 0.0
    sign = np.where(c, 1.0, -1.0)
    apart = volume.take(rows.hole_line * lines + rows.peg_line, axis=0)
    apart *= scale
    apart *= sign
    closing = speed.take(on_edge, axis=0)
    closing *= sign
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = apart / closing
    apart = np.where(crossing, apart, -FAR_M)
    closing = np.where(crossing, closing, 0.0)
    tags = _local(rows.start, len(apart)) + faces.names.edges_from
    return _bounds(ratio, apart, closing, rows.start, tags)


def _name(
    faces: MinkowskiFaces,
    tag: NDArray[np.int64],
    reach: Array,
    turn: Array,
    motion: Array,
    part: NDArray[np.intp] | slice,
    features: ContactFeatures,
) -> None:
    """Write the features that the tags (Q, n) stand for into rows `part`."""
    names = faces.names
    groups = len(faces.peg_support.start)
    pair = np.arange(faces.pairs)[:, None]
    on_hole, on_edge = tag < names.peg_faces_from, tag >= names.edges_from
    row_hole = np.minimum(faces.hole_faces.start[pair] + tag, len(faces.hole_faces.pair) - 1)
    row_peg = np.clip(faces.peg_faces.start[pair] + tag - names.peg_faces_from, 0, len(faces.peg_faces.pair) - 1)
    row_edge = np.clip(faces.edges.start[pair] + tag - names.edges_from, 0, len(faces.edges.pair) - 1)

    group = np.where(on_hole, faces.hole_faces.group[row_hole], groups + faces.peg_faces.group[row_peg])
    which = np.take_along_axis(reach, group, axis=0).view(np.int64) & _TAG
    start = np.concatenate([faces.peg_support.start, len(faces.peg_support.corner) + faces.hole_support.start])
    corner = np.concatenate([faces.peg_support.corner, len(faces.peg_corners_m) + faces.hole_support.corner])
    corners = np.concatenate([faces.peg_corners_m, faces.hole_corners_m])[corner[start[group] + which]]

    peg_line, hole_line = faces.edges.peg_line[row_edge], faces.edges.hole_line[row_edge]
    edge, hole = on_edge[..., None], on_hole[..., None]
    peg_direction = np.where(edge, faces.peg_directions[peg_line], faces.peg_faces.direction[row_peg])
    hole_direction = np.where(edge, faces.hole_directions[hole_line], faces.hole_faces.direction[row_hole])
    peg_point = np.where(
        edge, faces.peg_points_m[peg_line], np.where(hole, corners, faces.peg_faces.point_m[row_peg])
    )
    hole_point = np.where(
        edge, faces.hole_points_m[hole_line], np.where(hole, faces.hole_faces.point_m[row_hole], corners)
    )
    # The contact normal, from hole to peg, opposes the motion wherever a contact is entered.
    crossed = np.cross(np.einsum("ijn,qnj->qni", turn, peg_direction), hole_direction)
    sign = np.where(on_edge & (np.einsum("qni,in->qn", crossed, motion) > 0.0), -1.0, 1.0)
    kind = np.where(on_edge, EDGE_ON_EDGE, np.where(on_hole, PEG_CORNER_ON_FACE, PEG_FACE_ON_CORNER))
    features.kind[part] = kind.T
    features.peg_point_m[part] = peg_point.swapaxes(0, 1)
    features.peg_direction[part] = peg_direction.swapaxes(0, 1)
    features.hole_point_m[part] = hole_point.swapaxes(0, 1)
    features.hole_direction[part] = hole_direction.swapaxes(0, 1)
    features.sign[part] = sign.T
