"""The Greek-cross peg with a tapered tip, and the chamfered Greek-cross hole.

The sizes of both follow from the paper's Table 6: the taper shrinks linearly to an apex 89.7 mm ahead of the F/T
origin, the half-width falls by 0.25 per unit of length, and the half-length is three times the half-width.

Frames
------
peg frame {J}: origin at the F/T sensor's measuring origin {K}, z along the peg axis towards the tip, x and y along the
arms of the cross. hole frame {D}: origin at the centre of the rim in the plane of the outer face, z into the hole, so
that an inserted peg has its axes parallel to the hole's.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.convex import ConvexPiece
from crosspih_common.shapes.hole import CHAMFER_M, Hole
from crosspih_common.shapes.outline import Outline
from crosspih_common.shapes.peg import Peg


def cross_outline(half_width_m: float, half_length_m: float) -> Array:
    """The 12 corners (12, 2) of a Greek cross, m, counter-clockwise from the +x arm's lower outer corner."""
    w, el = half_width_m, half_length_m
    return np.array(
        [
            [el, -w], [el, w], [w, w], [w, el], [-w, el], [-w, w],
            [-el, w], [-el, -w], [-w, -w], [-w, -el], [w, -el], [w, -w],
        ]
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class CrossPeg(Peg):
    """The cross-shaped peg by the paper's own numbers, metres, in the peg frame {J}."""

    half_width_m: float = 0.009
    half_length_m: float = 0.027
    body_start_m: float = 0.012
    taper_slope: float = 0.25
    apex_m: float = 0.0897
    tip_half_width_m: float = 0.0025
    outline: Outline = field(init=False, repr=False)
    taper_start_m: float = field(init=False)
    tip_m: float = field(init=False)

    def __post_init__(self) -> None:
        if not 0.0 < self.tip_half_width_m < self.half_width_m < self.half_length_m:
            raise ValueError("a cross peg wants 0 < tip_half_width_m < half_width_m < half_length_m")
        if self.taper_slope <= 0.0:
            raise ValueError("a cross peg wants taper_slope > 0 and its taper to start ahead of body_start_m")
        corners = cross_outline(self.half_width_m, self.half_length_m)
        object.__setattr__(self, "outline", Outline.of("cross", corners, 4))
        object.__setattr__(self, "taper_start_m", self.apex_m - self.half_width_m / self.taper_slope)
        object.__setattr__(self, "tip_m", self.apex_m - self.tip_half_width_m / self.taper_slope)
        if self.taper_start_m <= self.body_start_m:
            raise ValueError("a cross peg wants taper_slope > 0 and its taper to start ahead of body_start_m")

    @property
    def length_ratio(self) -> float:
        """Half-length over half-width, constant along the taper."""
        return self.half_length_m / self.half_width_m

    def hole(self, clearance_m: float, chamfer_m: float = CHAMFER_M) -> CrossHole:
        """The hole that leaves the body a clearance (m) on every side."""
        half_width_m, half_length_m = self.half_width_m + clearance_m, self.half_length_m + clearance_m
        return CrossHole(half_width_m=half_width_m, half_length_m=half_length_m, chamfer_m=chamfer_m)

    def half_width_at_m(self, z_m: Array | float) -> Array:
        """The half-width of an arm at height z (any shape), m."""
        return np.minimum(self.half_width_m, self.taper_slope * (self.apex_m - np.asarray(z_m, float)))

    def outline_m(self, z_m: float) -> Array:
        """The section's 12 corners (12, 3) at height z, m, in `cross_outline` order."""
        width = float(self.half_width_at_m(z_m))
        return np.column_stack([cross_outline(width, width * self.length_ratio), np.full(12, z_m)])

    def pieces(self) -> list[ConvexPiece]:
        """The two crossing bars whose union is the peg, exactly: [along x, along y]."""
        a, ratio, apex = self.taper_slope, self.length_ratio, self.apex_m

        def bar(half_x: float, half_y: float, slope_x: float, slope_y: float) -> ConvexPiece:
            return ConvexPiece.from_planes(
                [
                    ((1, 0, 0), half_x), ((-1, 0, 0), half_x),
                    ((0, 1, 0), half_y), ((0, -1, 0), half_y),
                    ((1, 0, slope_x), slope_x * apex), ((-1, 0, slope_x), slope_x * apex),
                    ((0, 1, slope_y), slope_y * apex), ((0, -1, slope_y), slope_y * apex),
                    ((0, 0, 1), self.tip_m), ((0, 0, -1), -self.body_start_m),
                ]
            )  # fmt: skip

        return [
            bar(self.half_length_m, self.half_width_m, a * ratio, a),
            bar(self.half_width_m, self.half_length_m, a, a * ratio),
        ]


@dataclass(frozen=True, kw_only=True)
class CrossHole(Hole):
    """The hole for the cross by its own numbers, metres, in the hole frame {D}."""

    half_width_m: float = 0.0091
    half_length_m: float = 0.0271
    outline: Outline = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not 0.0 < self.half_width_m < self.half_length_m < self.plate_half_size_m - self.chamfer_m:
            raise ValueError("a cross hole wants 0 < half_width_m < half_length_m < plate_half_size_m - chamfer_m")
        corners = cross_outline(self.half_width_m, self.half_length_m)
        object.__setattr__(self, "outline", Outline.of("cross", corners, 4))
        super().__post_init__()

    def pieces(self) -> list[ConvexPiece]:
        """The eight convex blocks around the opening, chamfer included, exactly: four corner, then four end blocks."""
        w, el, c, size, depth = (
            self.half_width_m, self.half_length_m, self.chamfer_m, self.plate_half_size_m, self.depth_m,
        )  # fmt: skip
        slab = [((0, 0, -1), 0.0), ((0, 0, 1), depth)]
        blocks: list[ConvexPiece] = []
        for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
            blocks.append(
                ConvexPiece.from_planes(
                    [
                        ((-sx, 0, 0), -w),
                        ((-sx, 0, -1), -w - c),
                        ((sx, 0, 0), size),
                        ((0, -sy, 0), -w),
                        ((0, -sy, -1), -w - c),
                        ((0, sy, 0), size),
                        *slab,
                    ]
                )
            )
        for axis, sign in ((0, 1), (1, 1), (0, -1), (1, -1)):
            along = [0.0, 0.0, 0.0]
            along[axis] = float(sign)
            across = [0.0, 0.0, 0.0]
            across[1 - axis] = 1.0
            ax, ay, _ = along
            bx, by, _ = across
            blocks.append(
                ConvexPiece.from_planes(
                    [
                        ((-ax, -ay, 0), -el),
                        ((-ax, -ay, -1), -el - c),
                        ((ax, ay, 0), size),
                        ((bx, by, 0), w + c),
                        ((-bx, -by, 0), w + c),
                        *slab,
                    ]
                )
            )
        return blocks
