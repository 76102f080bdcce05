"""A peg of any section: a prism with a tapered tip.

Frame
-----
peg frame {J}: origin at the F/T sensor's measuring origin {K}, z along the peg axis towards the tip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.convex import ConvexPiece
from crosspih_common.shapes.cover import TOLERANCE_M, ConvexRegion
from crosspih_common.shapes.hole import CHAMFER_M, Hole
from crosspih_common.shapes.outline import Outline

Plane = tuple[tuple[float, float, float], float]


@dataclass(frozen=True)
class Peg:
    """The peg, in the peg frame {J}; all lengths in metres from the F/T origin along z.

    The section is the outline from `body_start_m` to `taper_start_m`; from there it shrinks linearly towards an apex
    on the axis, and is cut off at the tip. Every section must fit into the body's, so the axis must see the whole
    outline. Raises ValueError where it does not, and when the lengths are not in order.
    """

    outline: Outline
    body_start_m: float
    taper_start_m: float
    apex_m: float
    tip_m: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.body_start_m < self.taper_start_m < self.tip_m < self.apex_m:
            raise ValueError("a peg wants 0 <= body_start_m < taper_start_m < tip_m < apex_m")
        hidden = np.flatnonzero(self.outline.offsets_m < -TOLERANCE_M)
        if len(hidden):
            x, y = self.outline.corners_m[hidden[0]] * 1e3
            raise ValueError(
                f"outline {self.outline.name}: the peg's axis does not see the wall that begins at ({x:.2f}, {y:.2f}) "
                f"mm, so no taper towards it fits the hole; widen or leave out that slot, or move the outline"
            )

    @property
    def taper_length_m(self) -> float:
        """The length of the tapered part."""
        return self.tip_m - self.taper_start_m

    def scale_at(self, z_m: Array | float) -> Array:
        """The size of the section at height z (any shape) as a share of the body's: 1 on the body, 0 at the apex."""
        return np.minimum(1.0, (self.apex_m - np.asarray(z_m, float)) / (self.apex_m - self.taper_start_m))

    def outline_m(self, z_m: float) -> Array:
        """The section's corners (n, 3) at height z, m, in the outline's order."""
        corners = self.outline.corners_m * float(self.scale_at(z_m))
        return np.column_stack([corners, np.full(len(corners), z_m)])

    def taper_edges_m(self) -> tuple[Array, Array]:
        """The n edges of the taper: (tip ends N (n, 3), body ends M (n, 3)), m: the paper's lines M1N1.

        In the outline's order; those at its re-entrant corners cannot touch a rim.
        """
        return self.outline_m(self.tip_m), self.outline_m(self.taper_start_m)

    def pieces(self) -> list[ConvexPiece]:
        """Convex pieces, overlapping, whose union is the peg, exactly."""
        return [self._piece_of(part) for part in self.outline.convex_parts()]

    def hole(self, clearance_m: float, chamfer_m: float = CHAMFER_M) -> Hole:
        """The hole that leaves the body a clearance (m) on every side."""
        return Hole(self.outline.grown(clearance_m), chamfer_m)

    def _piece_of(self, part: ConvexRegion) -> ConvexPiece:
        """The part along the body, and shrinking towards the apex from where the taper starts."""
        planes: list[Plane] = [((0.0, 0.0, 1.0), self.tip_m), ((0.0, 0.0, -1.0), -self.body_start_m)]
        for (nx, ny), d in zip(part.normals, part.offsets_m, strict=True):
            planes.append(((float(nx), float(ny), 0.0), float(d)))
            if d > TOLERANCE_M:  # a wall on the axis stays there
                slope = float(d) / (self.apex_m - self.taper_start_m)
                planes.append(((float(nx), float(ny), slope), slope * self.apex_m))
        return ConvexPiece.from_planes(planes)
