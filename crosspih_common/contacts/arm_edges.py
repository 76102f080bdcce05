"""The eight taper edges of a cross peg's arms against the eight side rims of a cross hole's arms (Eqs. 18-19).

An arm has two edges at its end that can meet the hole: one is pushed along -(z x u) (sense 1), the other along
+(z x u) (sense 2), u the arm's direction. Arms 1 to 4 lie along +x, +y, -x, -y of the peg frame. Contacts are counted
by `edge_index`: arm 1 sense 1, arm 1 sense 2, arm 2 sense 1, ...
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import wrench_of_force_at_point
from crosspih_common.shapes import CrossHole, CrossPeg, Hole, Peg

ARM_DIRECTIONS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
EDGES = 8


def edge_index(arm: int, sense: int) -> int:
    """The index (0 to 7) of the contact of an arm (1 to 4) and a sense (1 or 2)."""
    return 2 * (arm - 1) + (sense - 1)


@dataclass(frozen=True, slots=True, eq=False)
class EdgeContacts:
    """At poses of any shape S: gap_m (*S, 8), negative where they cross; normal_peg (*S, 8, 3) from hole to peg;
    point_peg_m (*S, 8, 3); on_both (*S, 8): whether the point lies within both edges, not on their extensions.
    """

    gap_m: Array
    normal_peg: Array
    point_peg_m: Array
    on_both: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class ArmEdges:
    """Peg edges in the peg frame: tip_m (8, 3), along (8, 3) unit from tip to body, length_m (8,). Rims in the hole
    frame: rim_m (8, 3) on the inner rim at the arm's axis, outward (8, 3) unit; they reach from root_m to end_m along
    it. pushed (8, 3): the sense's direction, +-(z x u).
    """

    tip_m: Array
    along: Array
    length_m: Array
    rim_m: Array
    outward: Array
    pushed: Array
    root_m: float
    end_m: float

    @classmethod
    def of(cls, peg: Peg, hole: Hole) -> ArmEdges:
        """From the two drawings. Raises ValueError unless both are crosses: the 26 states are theirs."""
        if not isinstance(peg, CrossPeg) or not isinstance(hole, CrossHole):
            raise ValueError(f"the 26 contact states are those of a cross, the peg is a {peg.outline.name}")
        tips, bodies = peg.taper_edges_m()
        directions = np.repeat(ARM_DIRECTIONS, 2, axis=0)
        turned = np.cross([0.0, 0.0, 1.0], directions) * np.tile([-1.0, 1.0], 4)[:, None]
        # the edge that a push along `turned` meets lies on the other side of the arm
        corners = directions * peg.half_length_m - turned * peg.half_width_m
        chosen = np.argmin(np.linalg.norm(bodies[None, :, :2] - corners[:, None, :2], axis=2), axis=1)
        edges = bodies[chosen] - tips[chosen]
        lengths = np.linalg.norm(edges, axis=1)
        rim = -turned * hole.half_width_m + np.array([0.0, 0.0, hole.chamfer_m])
        return cls(
            tips[chosen],
            edges / lengths[:, None],
            lengths,
            rim,
            directions,
            turned,
            hole.half_width_m,
            hole.half_length_m,
        )

    def at(self, rotation_hole_peg: Array, translation_hole_peg_m: Array) -> EdgeContacts:
        """The eight contacts at peg poses in the hole frame: rotation (*S, 3, 3), translation (*S, 3), m."""
        rim = (self.rim_m - translation_hole_peg_m[..., None, :]) @ rotation_hole_peg
        outward = self.outward @ rotation_hole_peg
        normal = np.cross(self.along, outward)
        square = np.maximum(np.einsum("...i,...i->...", normal, normal), 1e-12)
        unit = normal * (np.sign(np.einsum("...i,...i->...", normal, self.pushed)) / np.sqrt(square))[..., None]
        between = rim - self.tip_m
        on_edge = np.einsum("...i,...i->...", np.cross(between, outward), normal) / square
        on_rim = np.einsum("...i,...i->...", np.cross(between, self.along), normal) / square
        within = (on_edge >= 0.0) & (on_edge <= self.length_m) & (on_rim >= self.root_m) & (on_rim <= self.end_m)
        return EdgeContacts(
            -np.einsum("...i,...i->...", unit, between), unit, self.tip_m + on_edge[..., None] * self.along, within
        )


def sliding_wrench(
    normal_peg: Array, point_peg_m: Array, friction_coefficient: ArrayLike, compliance_peg: Array, motion_peg: Array
) -> Array:
    """The wrench (..., 6) of contacts pressed with 1 N while the peg is driven along motion_peg (3,), peg frame.

    The wrist yields by compliance_peg (6, 6), so the point slides along v = d - C n (n.d)/(n.C n), C the compliance at
    the point; friction opposes it. This treats each contact as if it were the only one; for several it is approximate.
    """
    pushed = wrench_of_force_at_point(normal_peg, point_peg_m) @ compliance_peg.T
    gives = pushed[..., :3] + np.cross(pushed[..., 3:], point_peg_m)
    closing = (normal_peg @ motion_peg) / np.einsum("...i,...i->...", normal_peg, gives)
    velocity = motion_peg - gives * closing[..., None]
    speed = np.maximum(np.linalg.norm(velocity, axis=-1, keepdims=True), 1e-9)
    force = normal_peg - np.asarray(friction_coefficient)[..., None] * velocity / speed
    return wrench_of_force_at_point(force, point_peg_m)
