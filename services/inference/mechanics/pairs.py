"""The convex pieces of peg and hole, tabulated for the contact of every pair of pieces."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from crosspih_common.shapes import ConvexPiece
from services.inference.mechanics.minkowski import MinkowskiFaces
from services.inference.mechanics.polyhedron import Polyhedron

# Rotations of the peg against the hole (rad) for which the tables are pruned; the last covers every rotation.
CONES_RAD = (0.25, 0.6, np.pi)
ON_SIDE_M = 1e-9


class PegShape(Protocol):
    """A peg as convex pieces whose union it is, in the peg frame."""

    def pieces(self) -> list[ConvexPiece]: ...


class HoleShape(Protocol):
    """The plate around a hole as convex pieces whose union it is, in the hole frame."""

    @property
    def plate_half_size_m(self) -> float: ...

    def pieces(self) -> list[ConvexPiece]: ...


@dataclass(frozen=True, slots=True, eq=False)
class PairTables:
    """The peg's P pieces (peg frame) and the hole's H pieces (hole frame), with the tables for first contacts.

    peg and hole: their polyhedra. Faces (by index, a boolean (F,) each) that can never touch are marked in peg_faces
    and hole_faces as False: the peg's back, the plate's sides and back.
    """

    peg: tuple[Polyhedron, ...]
    hole: tuple[Polyhedron, ...]
    peg_faces: tuple[NDArray[np.bool_], ...]
    hole_faces: tuple[NDArray[np.bool_], ...]
    _by_cone: dict[float, MinkowskiFaces] = field(default_factory=dict)

    @classmethod
    def of(cls, peg: PegShape, hole: HoleShape) -> PairTables:
        """The tables of a peg and a hole: any convex pieces, any number of them, overlapping or not.

        The plate's sides and back, and the peg's back, are left out: they never meet.
        """
        return cls.of_polyhedra(
            tuple(Polyhedron.of(piece) for piece in peg.pieces()),
            tuple(Polyhedron.of(piece) for piece in hole.pieces()),
            hole.plate_half_size_m,
        )

    @classmethod
    def of_polyhedra(
        cls, peg: tuple[Polyhedron, ...], hole: tuple[Polyhedron, ...], plate_half_size_m: float
    ) -> PairTables:
        """The same from the pieces themselves."""

        def inward(solid: Polyhedron) -> NDArray[np.bool_]:
            side = np.abs(solid.offsets_m - plate_half_size_m) < ON_SIDE_M
            side &= np.abs(solid.normals[:, :2]).max(axis=1) > 1.0 - 1e-9
            return np.asarray(~side & (solid.normals[:, 2] < 0.5))

        return cls(
            peg, hole, tuple(solid.normals[:, 2] > -0.5 for solid in peg), tuple(inward(solid) for solid in hole)
        )

    @property
    def shape(self) -> tuple[int, int]:
        """(P, H): column p * H + h of a contact table is peg piece p with hole piece h."""
        return len(self.peg), len(self.hole)

    def faces_within(self, cone_rad: float) -> MinkowskiFaces:
        """The faces of the pieces' Minkowski differences while the peg is turned by at most cone_rad from the hole."""
        if cone_rad not in self._by_cone:
            self._by_cone[cone_rad] = MinkowskiFaces.of(self.peg, self.hole, self.peg_faces, self.hole_faces, cone_rad)
        return self._by_cone[cone_rad]
