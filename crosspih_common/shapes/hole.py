"""A chamfered hole of any section in a square plate.

Frame
-----
hole frame {D}: origin at the centre of the rim in the plane of the outer face, z into the hole, x and y so that an
inserted peg has its axes parallel to the hole's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.blocks import plate_blocks
from crosspih_common.shapes.convex import ConvexPiece
from crosspih_common.shapes.outline import Outline

CHAMFER_M = 0.001


@dataclass(frozen=True)
class Hole:
    """The hole, in the hole frame {D}: z = 0 at the outer face, z = `chamfer_m` at the inner rim, metres.

    `outline` is the bore's, the clearance included. The chamfer is at 45 degrees: on the outer face the opening is
    wider by `chamfer_m` on every side. Raises ValueError when the plate is too small or the chamfer too deep.
    """

    outline: Outline
    chamfer_m: float = CHAMFER_M
    depth_m: float = 0.05
    plate_half_size_m: float = 0.06

    def __post_init__(self) -> None:
        if not 0.0 <= self.chamfer_m < self.depth_m:
            raise ValueError("a hole wants 0 <= chamfer_m < depth_m")
        widest = self.opening().reach_m
        if widest >= self.plate_half_size_m:
            raise ValueError(
                f"hole {self.outline.name}: its rim reaches {widest * 1e3:.1f} mm from the axis, the plate "
                f"{self.plate_half_size_m * 1e3:.1f} mm; take a smaller outline"
            )

    def opening(self) -> Outline:
        """The outline on the outer face, the chamfer included."""
        return self.outline.grown(self.chamfer_m)

    def inner_rim_m(self) -> Array:
        """The n corners (n, 3) of the inner rim (chamfer meets bore), m: the paper's lines D1D2 join neighbours.

        The segment from corner i to corner i + 1 is the outline's edge i.
        """
        corners = self.outline.corners_m
        return np.column_stack([corners, np.full(len(corners), self.chamfer_m)])

    def outer_rim_m(self) -> Array:
        """The n corners (n, 3) of the outer rim (face meets chamfer), m; corner i is before corner i inside."""
        corners = self.opening().corners_m
        return np.column_stack([corners, np.zeros(len(corners))])

    def pieces(self) -> list[ConvexPiece]:
        """Convex blocks, overlapping, whose union is the plate around the opening, chamfer included, exactly."""
        return plate_blocks(self.outline, self.chamfer_m, self.depth_m, self.plate_half_size_m)
