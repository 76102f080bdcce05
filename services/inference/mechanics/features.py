"""A contact between two named features: its gap, normal and point as smooth functions of the pose (Eqs. 18-20)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array

PEG_CORNER_ON_FACE = 0
PEG_FACE_ON_CORNER = 1
EDGE_ON_EDGE = 2


@dataclass(frozen=True, slots=True, eq=False)
class ContactFeatures:
    """Contacts of any array shape S between a feature of the peg and one of the hole.

    kind S; peg_point_m (*S, 3) and peg_direction (*S, 3), peg frame: a corner on the feature, and its edge's direction
    or its face's outward normal; hole_point_m, hole_direction: the same in the hole frame; sign S: orientation, so that
    sign * (peg edge x hole edge) points from the hole to the peg.
    """

    kind: NDArray[np.int64]
    peg_point_m: Array
    peg_direction: Array
    hole_point_m: Array
    hole_direction: Array
    sign: Array

    def __getitem__(self, index: Any) -> ContactFeatures:
        return ContactFeatures(
            self.kind[index],
            self.peg_point_m[index],
            self.peg_direction[index],
            self.hole_point_m[index],
            self.hole_direction[index],
            self.sign[index],
        )


@dataclass(frozen=True, slots=True, eq=False)
class ContactGeometry:
    """gap_m S (negative: penetrating), normal_peg (*S, 3) from hole to peg, point_peg_m (*S, 3), in the peg frame."""

    gap_m: Array
    normal_peg: Array
    point_peg_m: Array


def contact_geometry(
    features: ContactFeatures, rotation_hole_peg: Array, translation_hole_peg_m: Array
) -> ContactGeometry:
    """Gap, normal and point of contacts S at poses broadcastable to S: rotation (*S, 3, 3), translation (*S, 3), m.

    Edge on edge: the normal is M1N1 x D1D2 (Eqs. 18-19), the point is where the peg's edge passes the hole's edge.
    """
    inverse = np.swapaxes(rotation_hole_peg, -1, -2)

    def to_peg(vectors: Array) -> Array:
        return np.asarray(np.einsum("...ij,...j->...i", inverse, vectors))

    a, b = features.peg_point_m, to_peg(features.hole_point_m - translation_hole_peg_m)
    peg_direction, hole_direction = features.peg_direction, to_peg(features.hole_direction)
    kind = features.kind[..., None]
    crossed = np.cross(peg_direction, hole_direction)
    square = np.maximum(np.einsum("...i,...i->...", crossed, crossed), 1e-12)
    edge_normal = crossed * (features.sign / np.sqrt(square))[..., None]
    normal = np.where(
        kind == EDGE_ON_EDGE, edge_normal, np.where(kind == PEG_CORNER_ON_FACE, hole_direction, -peg_direction)
    )
    along = np.einsum("...i,...i->...", np.cross(b - a, hole_direction), crossed) / square
    on_edge = a + along[..., None] * peg_direction
    point = np.where(kind == EDGE_ON_EDGE, on_edge, np.where(kind == PEG_CORNER_ON_FACE, a, b))
    return ContactGeometry(np.einsum("...i,...i->...", normal, a - b), normal, point)
