"""The straight walls of a bore around the body of a peg, for any outline: the points that can touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole, Peg

LARGEST_CLEARANCE_M = 5e-3
PARALLEL = 1.0 - 1e-6
PLANE = np.array([0, 1, 3, 4, 5])  # of a twist or wrench: all but the axial component


@dataclass(frozen=True, slots=True, eq=False)
class BoreWalls:
    """Both ends of every stretch on which a side of the peg and a wall of the bore face each other, hole frame.

    places_m (J, 2); normals (J, 2): unit, from the wall into the peg; clearances_m (J,), with the peg centred.
    turn_fixed: whether the walls hold the rotation about the axis; false for a round bore, also if its circle is cut
    into sides, and for any peg that turns freely in its hole.
    """

    places_m: Array
    normals: Array
    clearances_m: Array
    turn_fixed: bool

    @classmethod
    def of(cls, peg: Peg, hole: Hole) -> BoreWalls:
        """The walls of a hole around the peg's body. Raises ValueError when no side of the peg faces a wall."""
        body, bore = peg.outline_m(peg.taper_start_m)[:, :2], hole.inner_rim_m()[:, :2]
        peg_sides, walls = _sides(body), _sides(bore)
        places, normals, clearances = [], [], []
        for start, end, along, outward in zip(*peg_sides, strict=True):
            for wall_start, wall_end, _, wall_outward in zip(*walls, strict=True):
                clearance = float(outward @ (wall_start - start))
                if outward @ wall_outward < PARALLEL or not -1e-9 <= clearance < LARGEST_CLEARANCE_M:
                    continue
                first = max(float(along @ start), float(along @ wall_start))
                last = min(float(along @ end), float(along @ wall_end))
                if last <= first:
                    continue
                for where in (first, last):
                    places.append(where * along + float(outward @ start) * outward)
                    normals.append(-outward)
                    clearances.append(clearance)
        if not places:
            raise ValueError("no side of the peg faces a wall of the hole: want the hole's outline around the peg's")
        held = peg.outline.symmetry_order != 0 and peg.outline.radius_m > hole.outline.inner_radius_m
        return cls(np.array(places), np.array(normals), np.array(clearances), held)

    @property
    def clearance_m(self) -> float:
        """The least clearance, m."""
        return float(self.clearances_m.min())

    def points(self, height_m: float) -> Array:
        """(J, 5): a_j of every point at one height, hole frame: normal x, y, and its moment about the origin.

        If the walls do not hold the rotation, the moment about the axis is 0.
        """
        n = np.column_stack([self.normals, np.zeros(len(self.normals))])
        p = np.column_stack([self.places_m, np.full(len(n), height_m)])
        moments = np.cross(p, n)
        if not self.turn_fixed:
            moments[:, 2] = 0.0
        return np.column_stack([self.normals, moments])


def _sides(corners_m: Array) -> tuple[Array, Array, Array, Array]:
    """Start, end, direction and outward normal (n, 2) each of the sides of a counter-clockwise outline (n, 2)."""
    end = np.roll(corners_m, -1, axis=0)
    along = end - corners_m
    length = np.linalg.norm(along, axis=1)
    keep = length > 1e-9
    along = along[keep] / length[keep, None]
    return corners_m[keep], end[keep], along, np.column_stack([along[:, 1], -along[:, 0]])
