"""All contacts of peg and hole near a pose, between features of their surfaces.

A corner is tested against every face that it stands over; an edge against every edge that it passes within both their
lengths while their arcs on the Gauss sphere cross (see `minkowski`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.inference.mechanics.features import (
    EDGE_ON_EDGE,
    PEG_CORNER_ON_FACE,
    PEG_FACE_ON_CORNER,
    ContactFeatures,
)
from services.inference.mechanics.minkowski import Index
from services.inference.mechanics.pairs import PairTables
from services.inference.mechanics.polyhedron import arc_arc_angle
from services.inference.mechanics.surface import Surface

PORTION = 100_000
FEWEST, MAX_ = 8, 512
# Corners and faces, and pairs of edges, are tested up to this angle beyond a possible first contact: when a face comes
# to rest flat, its other end is then listed before it touches.
MARGIN_RAD = 0.05
# How far past the end of an edge, or the side of a face, a contact still counts.
BEYOND_M = 1e-7
# Edges nearer to parallel than this have no common normal: corners on faces cover that case.
PARALLEL_SQUARE = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class NearContacts:
    """For N poses up to M contacts, the nearest first: present (N, M), gap_m (N, M), features of shape (N, M), and key
    (N, M): the same number for the same features."""

    present: NDArray[np.bool_]
    gap_m: Array
    features: ContactFeatures
    key: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePair:
    """The surfaces of peg and hole, and the features that can meet while the peg is rotated by at most cone_rad.

    peg_corner, hole_face (L1,); hole_corner, peg_face (L2,); peg_edge, hole_edge (L3,). skin_m: thickness of a layer on
    both bodies, which rounds edges and corners.
    """

    peg: Surface
    hole: Surface
    cone_rad: float
    skin_m: float
    peg_corner: Index
    hole_face: Index
    hole_corner: Index
    peg_face: Index
    peg_edge: Index
    hole_edge: Index
    names: ContactFeatures = field(repr=False)
    keys: NDArray[np.int64] = field(repr=False)

    @classmethod
    def of(cls, tables: PairTables, cone_rad: float = 0.3, skin_m: float = 0.0) -> SurfacePair:
        """From the pieces in the tables, covered by a skin (m).

        Pieces inset by r and with a skin of r keep their faces in place and have edges of radius r.
        """
        peg = Surface.of(tables.peg, tables.peg_faces)
        hole = Surface.of(tables.hole, tables.hole_faces)
        reach = np.sin(min(cone_rad + MARGIN_RAD, np.pi / 2.0))

        def may_touch(body: Surface, other: Surface) -> tuple[Index, Index]:
            # A corner is lowest over a face if no edge leaves it downwards; within the cone: none steeply.
            steepest = np.einsum("ckj,fj->cfk", body.corner_neighbours, other.face_normals).min(axis=2)
            corner, face = np.nonzero(steepest >= -reach)
            return corner, face

        peg_corner, hole_face = may_touch(peg, hole)
        hole_corner, peg_face = may_touch(hole, peg)
        angle = arc_arc_angle(
            -peg.edge_normals_a[:, None], -peg.edge_normals_b[:, None], hole.edge_normals_a, hole.edge_normals_b
        )
        peg_edge, hole_edge = np.nonzero(angle <= cone_rad + MARGIN_RAD)
        on_hole, on_peg, edges = len(peg_corner), len(hole_corner), len(peg_edge)

        def on_face(surface: Surface, face: Index) -> Array:
            return np.asarray(surface.face_normals[face] * surface.face_offsets_m[face, None])

        names = ContactFeatures(
            np.repeat([PEG_CORNER_ON_FACE, PEG_FACE_ON_CORNER, EDGE_ON_EDGE], [on_hole, on_peg, edges]),
            np.concatenate([peg.corners_m[peg_corner], on_face(peg, peg_face), peg.edge_middles_m[peg_edge]]),
            np.concatenate([-hole.face_normals[hole_face], peg.face_normals[peg_face], peg.edge_directions[peg_edge]]),
            np.concatenate([on_face(hole, hole_face), hole.corners_m[hole_corner], hole.edge_middles_m[hole_edge]]),
            np.concatenate(
                [hole.face_normals[hole_face], -peg.face_normals[peg_face], hole.edge_directions[hole_edge]]
            ),
            np.ones(on_hole + on_peg + edges),
        )
        # A corner over faces of several pieces in one plane is one contact.
        first = peg_corner * (hole.face_planes.max() + 1) + hole.face_planes[hole_face]
        second = hole_corner * (peg.face_planes.max() + 1) + peg.face_planes[peg_face]
        third = np.arange(edges)
        keys = np.concatenate([first * 3, second * 3 + 1, third * 3 + 2]).astype(np.int64)
        return cls(
            peg,
            hole,
            cone_rad,
            skin_m,
            peg_corner,
            hole_face,
            hole_corner,
            peg_face,
            peg_edge,
            hole_edge,
            names,
            keys,
        )

    def near(self, rotation_hole_peg: Array, translation_hole_peg_m: Array, band_m: Array, most: int) -> NearContacts:
        """The contacts with a gap within about +-band_m (N,) at peg poses (N, 3, 3), (N, 3) in the hole frame, m.

        At most `most` per pose. Raises ValueError for a pose rotated by more than cone_rad.
        """
        n = len(rotation_hole_peg)
        turned = np.arccos(np.clip((np.einsum("nii->n", rotation_hole_peg) - 1.0) / 2.0, -1.0, 1.0))
        if np.any(turned > self.cone_rad):
            raise ValueError(
                f"a peg is turned by {turned.max():.3f} rad; the tables hold to {self.cone_rad:.3f}: "
                f"make them with a larger cone_rad"
            )
        portion = int(np.clip(PORTION // max(len(self.peg_edge), 1), FEWEST, MAX_))
        present = np.zeros((n, most), dtype=bool)
        gap, sign = np.full((n, most), np.inf), np.ones((n, most))
        row = np.zeros((n, most), dtype=np.intp)
        for start in range(0, n, portion):
            part = slice(start, min(start + portion, n))
            self._portion(
                rotation_hole_peg[part], translation_hole_peg_m[part], band_m[part],
                present[part], gap[part], sign[part], row[part],
            )  # fmt: skip
        names = self.names[row]
        features = ContactFeatures(
            names.kind, names.peg_point_m, names.peg_direction, names.hole_point_m, names.hole_direction, sign
        )
        return NearContacts(present, gap, features, np.where(present, self.keys[row], -1))

    def _portion(
        self,
        rotation: Array,
        translation: Array,
        band_m: Array,
        present: NDArray[np.bool_],
        gap: Array,
        sign: Array,
        row: Index,
    ) -> None:
        """Near contacts of some poses, written into present, gap, sign and row."""
        peg, hole = self.peg, self.hole
        found = [
            _corners_on_faces(
                np.einsum("nij,cj->cni", rotation, peg.corners_m) + translation,
                hole, self.peg_corner, self.hole_face, band_m,
            ),
            _corners_on_faces(
                np.einsum("nji,cnj->cni", rotation, hole.corners_m[:, None] - translation),
                peg, self.hole_corner, self.peg_face, band_m,
            ),
            self._edges(rotation, translation, band_m),
        ]  # fmt: skip
        offsets = np.cumsum([0, len(self.peg_corner), len(self.hole_corner)])
        rows = np.concatenate([part[0] + offset for part, offset in zip(found, offsets, strict=True)])
        pose, gaps, signs = (np.concatenate([part[k] for part in found]) for k in (1, 2, 3))
        if len(rows) == 0:
            return
        _, single = np.unique(np.stack([pose, self.keys[rows]]), axis=1, return_index=True)
        rows, pose, gaps, signs = rows[single], pose[single], gaps[single], signs[single]
        order = np.lexsort((gaps, pose))
        rows, pose, gaps, signs = rows[order], pose[order], gaps[order], signs[order]
        place = np.arange(len(pose)) - np.searchsorted(pose, pose)
        keep = place < gap.shape[1]
        at = pose[keep], place[keep]
        present[at], gap[at], sign[at], row[at] = True, gaps[keep] - 2.0 * self.skin_m, signs[keep], rows[keep]

    def _edges(self, rotation: Array, translation: Array, band_m: Array) -> tuple[Index, Index, Array, Array]:
        """Rows, poses, gaps and signs of edges that pass each other near."""
        peg, hole = self.peg, self.hole
        n = len(rotation)
        turn = np.ascontiguousarray(rotation.transpose(1, 2, 0))
        vectors = np.concatenate([peg.edge_middles_m, peg.edge_directions, peg.edge_normals_a, peg.edge_normals_b])
        middles, along, normals_a, normals_b = np.split(vectors @ turn, 4, axis=1)
        middles = middles + translation.T[:, None]
        lines = len(peg.edge_middles_m)
        at = self.hole_edge * lines + self.peg_edge

        def dots(of_hole: Array, of_peg: Array) -> Array:
            return np.asarray((of_hole @ of_peg.reshape(3, -1)).reshape(-1, n))

        direction = hole.edge_directions
        # Arcs cross where the ends of each lie on both sides of the other, in the same hemisphere: in one orientation
        # all four of these are positive, in the other all negative.
        ends = np.stack(
            [
                dots(hole.edge_normals_a, along).take(at, axis=0),
                -dots(hole.edge_normals_b, along).take(at, axis=0),
                dots(direction, normals_a).take(at, axis=0),
                -dots(direction, normals_b).take(at, axis=0),
            ]
        )
        crossing = (ends.min(axis=0) > -MARGIN_RAD) | (ends.max(axis=0) < MARGIN_RAD)
        rows, pose = np.nonzero(crossing)
        if len(rows) == 0:
            empty = np.zeros(0, dtype=np.intp)
            return empty, empty, np.zeros(0), np.zeros(0)
        edge, other = self.peg_edge[rows], self.hole_edge[rows]
        e, p = along[:, edge, pose], middles[:, edge, pose]
        f, q = direction[other].T, hole.edge_middles_m[other].T
        cosine = (e * f).sum(axis=0)
        square = 1.0 - cosine**2
        between = q - p
        on_e, on_f = (between * e).sum(axis=0), (between * f).sum(axis=0)
        safe = np.maximum(square, PARALLEL_SQUARE)
        in_peg = np.abs(on_e - cosine * on_f) <= (peg.edge_halves_m[edge] + BEYOND_M) * safe
        in_hole = np.abs(cosine * on_e - on_f) <= (hole.edge_halves_m[other] + BEYOND_M) * safe
        sign = np.where(ends[:, rows, pose].sum(axis=0) > 0.0, 1.0, -1.0)
        volume = (np.cross(e, f, axis=0) * between).sum(axis=0)
        gap = -sign * volume / np.sqrt(safe)
        near = (square > PARALLEL_SQUARE) & in_peg & in_hole & (np.abs(gap) < band_m[pose])
        return rows[near], pose[near], gap[near], sign[near]


def _corners_on_faces(
    corners: Array, body: Surface, corner: Index, face: Index, band_m: Array
) -> tuple[Index, Index, Array, Array]:
    """Rows, poses, gaps and signs (1) of corners (C, n, 3), in the body's frame, that stand near over its faces."""
    points = corners[corner]  # (L, n, 3)
    gap = np.einsum("lnj,lj->ln", points, body.face_normals[face]) - body.face_offsets_m[face, None]
    rows, pose = np.nonzero(np.abs(gap) < band_m)
    sides = body.face_sides[face[rows]]
    beyond = np.einsum("rsj,rj->rs", sides[..., :3], points[rows, pose]) - sides[..., 3]
    over = beyond.max(axis=1, initial=-np.inf) <= BEYOND_M
    rows, pose = rows[over], pose[over]
    return rows, pose, gap[rows, pose], np.ones(len(rows))
