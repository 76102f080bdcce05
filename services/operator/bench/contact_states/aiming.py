"""Predicts which arms a push makes touch: taper edges on side rims, an elastic wrist, forces that only press.

A first guess for choosing pose errors, not a label: the label comes from the simulator's contact points. The wrist is
driven along the peg's axis; at a travel s the forces solve f >= 0, gap >= 0, f gap = 0 with gap = g(s) + J C J^T f
(projected Gauss-Seidel), linearised anew at the deflected pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.contacts import ArmEdges, sliding_wrench
from crosspih_common.geometry import rotation_from_error_angles
from crosspih_common.geometry.pose import Array

SWEEPS = 12
STEPS = 9
Z = np.array([0.0, 0.0, 1.0])
# an edge that presses with a smaller share of the largest force does not count as touching
MIN_SHARE = 0.03
FAR_M = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class AimedPushes:
    """N pushes: angles_rad (N, 3) alpha, beta, gamma; lateral_m (N, 2) of the tip-ward axis at the rim; travel_m (N,)
    from the axis point `ahead_m` short of the rim to first contact; wanted_n (N,) the target |F|; force_n (N, 8) on
    each edge there.
    """

    angles_rad: Array
    lateral_m: Array
    travel_m: Array
    wanted_n: Array
    force_n: Array

    def pattern(self) -> Array:
        """(N,) the touching edges as the bits of an integer; 0 where nothing was found."""
        largest = self.force_n.max(axis=1, keepdims=True)
        touching = self.force_n > MIN_SHARE * np.maximum(largest, 1e-9)
        return np.asarray(touching @ (1 << np.arange(8)), dtype=np.int64)


def pattern_of(arms: tuple[int, ...], sense: int) -> int:
    """The bits of the edges of these arms and this sense."""
    return sum(1 << (2 * (arm - 1) + sense - 1) for arm in arms)


def start_translation_m(rotation_hole_peg: Array, lateral_m: Array, ahead_m: float) -> Array:
    """(N, 3): the peg frame's origin for which the axis meets the face's plane at lateral_m, `ahead_m` further on."""
    axis = rotation_hole_peg[..., :, 2]
    meets = np.concatenate([lateral_m, np.zeros((*lateral_m.shape[:-1], 1))], axis=-1)
    return np.asarray(meets - axis * (ahead_m / axis[..., 2:]))


def predict_pushes(
    edges: ArmEdges,
    compliance_peg: Array,
    friction: float,
    angles_rad: Array,
    lateral_m: Array,
    force_n: Array,
    ahead_m: float,
) -> AimedPushes:
    """The forces on the eight edges when N pegs are driven along their own axes until |F| reaches force_n (N,).

    compliance_peg (6, 6); ahead_m: how far the F/T origin begins before the hole's face, along the peg's axis.
    """
    rotation = np.swapaxes(rotation_from_error_angles(angles_rad), 1, 2)
    start = start_translation_m(rotation, lateral_m, ahead_m)
    axis = rotation[:, :, 2]
    first = edges.at(rotation, start)
    closing = -np.einsum("nki,i->nk", first.normal_peg, Z)
    # motion along a straight line keeps normals, so the gap shrinks linearly
    reach = np.where(closing > 1e-6, first.gap_m / np.maximum(closing, 1e-6), np.inf)
    on_both = edges.at(rotation[:, None], start[:, None] + reach_or_zero(reach)[..., None] * axis[:, None])
    hits = np.where(np.einsum("nkk->nk", on_both.on_both), reach, np.inf)
    travel = hits.min(axis=1)
    found = np.isfinite(travel)
    travel = np.where(found, travel, 0.0)

    n = len(rotation)
    forces = np.zeros((n, 8))
    step = force_n * 1.2e-5  # the deflection of a fairly stiff wrist; adapted below
    further = np.zeros(n)
    wrench = np.zeros((n, 6))
    for _ in range(STEPS):
        further = further + step
        commanded = start + (travel + further)[:, None] * axis
        twist = wrench @ compliance_peg.T
        turned = rotation @ Rotation.from_rotvec(twist[:, 3:]).as_matrix()
        place = commanded + np.einsum("nij,nj->ni", rotation, twist[:, :3])
        contact = edges.at(turned, place)
        normal = np.concatenate([contact.normal_peg, np.cross(contact.point_peg_m, contact.normal_peg)], axis=-1)
        pressing = sliding_wrench(contact.normal_peg, contact.point_peg_m, friction, compliance_peg, Z)
        coupling = np.einsum("nki,ij,nlj->nkl", normal, compliance_peg, pressing)
        gap = np.where(contact.on_both, contact.gap_m, FAR_M) - np.einsum("nkl,nl->nk", coupling, forces)
        forces = _gauss_seidel(coupling, gap, forces)
        wrench = np.einsum("nk,nki->ni", forces, pressing)
        size = np.linalg.norm(wrench[:, :3], axis=1)
        # extrapolate to the target force by the slope so far
        slope = np.maximum(size, 0.3) / np.maximum(further, 1e-6)
        step = np.clip((force_n - size) / slope, -0.5 * further, np.maximum(further, 2e-4))
    forces[~found] = 0.0
    return AimedPushes(angles_rad, lateral_m, np.where(found, travel, np.inf), force_n, forces)


def reach_or_zero(reach_m: Array) -> Array:
    """Travels with the infinite ones set to zero, so that geometry can be computed."""
    return np.where(np.isfinite(reach_m), reach_m, 0.0)


def _gauss_seidel(coupling: Array, gap: Array, forces: Array) -> Array:
    forces = forces.copy()
    diagonal = np.maximum(np.einsum("nkk->nk", coupling), 1e-9)
    for _ in range(SWEEPS):
        for k in range(forces.shape[1]):
            rest = gap[:, k] + np.einsum("nl,nl->n", coupling[:, k], forces)
            forces[:, k] = np.maximum(forces[:, k] - rest / diagonal[:, k], 0.0)
    return forces
