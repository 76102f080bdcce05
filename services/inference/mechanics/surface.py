"""The parts of a union of convex pieces that can touch: its convex edges, corners and faces, without interior parts.

Where the surfaces of two pieces cross, their union has an inward edge, which cannot touch. So every edge that can touch
is a part of some piece's edge; this module finds these parts from their surroundings.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.inference.mechanics.polyhedron import Polyhedron

AROUND_M = 1e-6
AROUND = 72
SHORTEST_M = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """E edges, C corners and F faces of a body in its own frame, metres.

    edge_middles_m, edge_directions, edge_normals_a, edge_normals_b (E, 3), edge_halves_m (E,): an edge runs half its
    length to either side of its middle, along b x a, a and b the outward normals of the faces beside it. corners_m
    (C, 3); corner_neighbours (C, K, 3): unit directions of the edges that leave a corner, repeated where it has fewer.
    face_normals (F, 3), face_offsets_m (F,); face_sides (F, S, 4): planes (x, y, z, offset) through the face's sides,
    square to it, outward; a side is repeated where a face has fewer. face_planes (F,): faces in one plane share a
    number.
    """

    edge_middles_m: Array
    edge_directions: Array
    edge_normals_a: Array
    edge_normals_b: Array
    edge_halves_m: Array
    corners_m: Array
    corner_neighbours: Array
    face_normals: Array
    face_offsets_m: Array
    face_sides: Array
    face_planes: NDArray[np.intp]

    @classmethod
    def of(cls, pieces: Sequence[Polyhedron], kept: Sequence[NDArray[np.bool_]]) -> Surface:
        """From the pieces' union; kept: boolean (F,) per piece, the faces that can touch."""
        edges = [
            edge
            for index, (solid, used) in enumerate(zip(pieces, kept, strict=True))
            for edge in _edges(solid, used, [other for k, other in enumerate(pieces) if k != index])
        ]
        edges = list({_key(edge): edge for edge in edges}.values())
        faces = [
            face
            for index, (solid, used) in enumerate(zip(pieces, kept, strict=True))
            for face in _faces(solid, used, [other for k, other in enumerate(pieces) if k != index])
        ]
        corners, neighbours = _corners(edges, pieces)
        planes = np.round(np.array([[*normal, offset] for normal, offset, _ in faces]), 9) + 0.0
        return cls(
            np.array([edge[0] for edge in edges]),
            np.array([edge[1] for edge in edges]),
            np.array([edge[2] for edge in edges]),
            np.array([edge[3] for edge in edges]),
            np.array([edge[4] for edge in edges]),
            corners,
            neighbours,
            np.array([normal for normal, _, _ in faces]),
            np.array([offset for _, offset, _ in faces]),
            _padded([sides for _, _, sides in faces]),
            np.asarray(np.unique(planes, axis=0, return_inverse=True)[1], dtype=np.intp).ravel(),
        )


Edge = tuple[Array, Array, Array, Array, float]
"""Middle, direction, normals a and b, half of the length."""


def _key(edge: Edge) -> tuple[float, ...]:
    """The same key for equal edges of two pieces."""
    normals = sorted([tuple(np.round(edge[2], 9) + 0.0), tuple(np.round(edge[3], 9) + 0.0)])
    return (*np.round(edge[0], 8) + 0.0, *normals[0], *normals[1])


def _inside(points: Array, pieces: Sequence[Polyhedron], slack_m: float = 0.0) -> NDArray[np.bool_]:
    """Which points (..., 3) lie in some piece, or within the slack of it, m."""
    inside = np.zeros(points.shape[:-1], dtype=bool)
    for solid in pieces:
        inside |= np.all(points @ solid.normals.T <= solid.offsets_m + slack_m, axis=-1)
    return inside


def _edges(solid: Polyhedron, kept: NDArray[np.bool_], others: Sequence[Polyhedron]) -> list[Edge]:
    """The parts of a piece's edges along which the union has the same shape as the piece."""
    found: list[Edge] = []
    directions = solid.edge_directions
    turn = np.arange(AROUND) * (2.0 * np.pi / AROUND) + 0.01
    for (first, second), (a, b), along in zip(solid.edges, solid.edge_faces, directions, strict=True):
        if not (kept[a] and kept[b]):
            continue
        start, end = solid.corners_m[first], solid.corners_m[second]
        length = float(np.linalg.norm(end - start))
        cuts = [0.0, length]
        for other in others:
            slope = other.normals @ along
            with np.errstate(divide="ignore", invalid="ignore"):
                at = (other.offsets_m - other.normals @ start) / slope
            cuts.extend(float(s) for s in at[np.abs(slope) > 1e-9] if SHORTEST_M < s < length - SHORTEST_M)
        cuts = sorted(cuts)
        outward = solid.normals[a] + solid.normals[b]
        outward = outward / np.linalg.norm(outward)
        aside = np.cross(along, outward)
        circle = AROUND_M * (np.cos(turn)[:, None] * outward + np.sin(turn)[:, None] * aside)
        own = np.count_nonzero(_inside(start + along * (length / 2.0) + circle, [solid]))
        free: list[list[float]] = []
        for low, high in itertools.pairwise(cuts):
            if high - low < SHORTEST_M:
                continue
            ring = start + along * ((low + high) / 2.0) + circle
            if np.count_nonzero(_inside(ring, [solid, *others], 1e-12)) > own + 1:
                continue
            if free and abs(free[-1][1] - low) < 2.0 * SHORTEST_M:
                free[-1][1] = high
            else:
                free.append([low, high])
        found.extend(
            (start + along * ((low + high) / 2.0), along, solid.normals[a], solid.normals[b], (high - low) / 2.0)
            for low, high in free
        )
    return found


def _corners(edges: list[Edge], pieces: Sequence[Polyhedron]) -> tuple[Array, Array]:
    """The pieces' corners where edges end, and the unit directions of these edges."""
    ends: dict[tuple[float, ...], list[Array]] = {}
    for middle, along, _, _, half in edges:
        for sign in (-1.0, 1.0):
            at = tuple(np.round(middle + sign * half * along, 8) + 0.0)
            ends.setdefault(at, []).append(-sign * along)
    own = {tuple(np.round(corner, 8) + 0.0) for solid in pieces for corner in solid.corners_m}
    kept = {at: around for at, around in ends.items() if at in own and len(around) >= 2}
    if not kept:
        return np.zeros((0, 3)), np.zeros((0, 1, 3))
    return np.array(list(kept)), _padded([np.array(around) for around in kept.values()])


def _faces(
    solid: Polyhedron, kept: NDArray[np.bool_], others: Sequence[Polyhedron]
) -> list[tuple[Array, float, Array]]:
    """Normal, offset and sides (S, 4) of a piece's faces that are at least partly on the union's surface."""
    found = []
    for face in np.flatnonzero(kept):
        normal, offset = solid.normals[face], float(solid.offsets_m[face])
        around = solid.corners_m[solid.on_face[:, face]]
        middle = around.mean(axis=0)
        # Points over the face, denser towards its corners, because a face may be exposed along a narrow strip only.
        near = np.concatenate([middle + (around - middle) * share for share in (0.0, 0.5, 0.9, 0.99)])
        between = (near[:, None] + near[None]).reshape(-1, 3) / 2.0
        if np.all(_inside(np.concatenate([near, between]) + AROUND_M * normal, others)):
            continue
        sides = []
        for edge in np.flatnonzero((solid.edge_faces == face).any(axis=1)):
            out = np.cross(solid.edge_directions[edge], normal)
            at = solid.corners_m[solid.edges[edge, 0]]
            out = out if out @ (middle - at) < 0.0 else -out
            sides.append([*out, float(out @ at)])
        found.append((normal, offset, np.array(sides)))
    return found


def _padded(rows: list[Array]) -> Array:
    """Stack arrays (k_i, d) to (n, max k, d), repeating each one's first row."""
    longest = max(len(row) for row in rows)
    return np.array([np.vstack([row, np.repeat(row[:1], longest - len(row), axis=0)]) for row in rows])
