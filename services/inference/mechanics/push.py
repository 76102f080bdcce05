"""A push with any number of contacts: the final pose of the peg and the forces, for many pushes at once.

The wrist's motor side is driven past first contact in small steps. In each step the peg moves to where wrist, contacts
and friction balance (`complementarity`), with the near contacts found anew (`near_contact`). So contacts are made and
broken in order, and friction opposes the actual slip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rotation import rotation_of
from services.inference.mechanics.complementarity import contact_forces
from services.inference.mechanics.features import ContactFeatures, contact_geometry
from services.inference.mechanics.first_contact import first_contact
from services.inference.mechanics.near_contact import NearContacts, SurfacePair
from services.inference.mechanics.pairs import PairTables

# Contacts are searched this much farther than the peg moves in a step.
AHEAD_M = 5e-6
# Distance from the F/T origin to the contacts: bounds their motion by a rotation in a step.
LEVER_M = 0.08
SETTLED_M = 1e-8


@dataclass(frozen=True, slots=True)
class PushSettings:
    """steps: of the travel past first contact; most_contacts: kept at a time, the nearest; sweeps: of the solver in a
    step, and ten times as many in the last."""

    steps: int = 24
    most_contacts: int = 16
    sweeps: int = 120


@dataclass(frozen=True, slots=True, eq=False)
class PushedPegs:
    """N pushes, M contacts each at most.

    travel_m (N,): of the motor side to first contact, inf if there is none, or nothing that holds. rotation
    (N, 3, 3), translation_m (N, 3): the peg's pose in the hole frame. wrench_peg (N, 6): on the peg, in its frame.
    force_n (N, M): normal force of each contact, 0 where it does not press; force_peg_n (N, M, 3) with friction;
    point_peg_m (N, M, 3); features of shape (N, M). residual_n (N,): remaining imbalance of the forces.
    """

    travel_m: Array
    rotation: Array
    translation_m: Array
    wrench_peg: Array
    force_n: Array
    force_peg_n: Array
    point_peg_m: Array
    features: ContactFeatures
    residual_n: Array

    @property
    def pressing(self) -> NDArray[np.bool_]:
        """Which contacts press with more than a millinewton, (N, M)."""
        return np.asarray(self.force_n > 1e-3)


def push(
    tables: PairTables,
    surfaces: SurfacePair,
    rotation_hole_peg: Array,
    translation_hole_peg_m: Array,
    direction_hole: Array,
    past_contact_m: ArrayLike,
    compliance_peg: Array,
    friction_coefficient: ArrayLike,
    settings: PushSettings | None = None,
) -> PushedPegs:
    """Push N pegs from poses (N, 3, 3), (N, 3), free of the hole, along directions (N, 3) in the hole frame.

    The motor side travels past_contact_m (N,) farther than first contact, without turning. compliance_peg (6, 6) or
    (N, 6, 6): twist of the peg per wrench on it, in its frame. friction_coefficient: () or (N,).
    """
    settings = settings or PushSettings()
    commanded = np.asarray(rotation_hole_peg, float)
    n = len(commanded)
    direction = np.asarray(direction_hole, float)
    past = np.broadcast_to(np.asarray(past_contact_m, float), n)
    compliance = np.broadcast_to(compliance_peg, (n, 6, 6))
    friction = np.broadcast_to(np.asarray(friction_coefficient, float), n)
    travel = first_contact(tables, commanded, translation_hole_peg_m, direction).travel_m
    touches = np.isfinite(travel)
    start = translation_hole_peg_m + np.where(touches, travel, 0.0)[:, None] * direction
    state = _State.touching(commanded, start, settings.most_contacts, surfaces)
    stride = np.maximum(past / settings.steps, 1e-7)
    for step in range(1, settings.steps + 1):
        target = start + (past * step / settings.steps)[:, None] * direction
        last = step == settings.steps
        state.advance(commanded, target, compliance, friction, stride, settings.sweeps * (10 if last else 1), touches)
    # A peg that slipped off needs longer steps than the wrist to come to rest.
    for _ in range(2 * settings.steps):
        moving = touches & state.held_back
        if not np.any(moving):
            break
        state.advance(commanded, target, compliance, friction, stride, settings.sweeps, moving)
    return state.result(travel)


class _State:
    """The pegs while they are pushed."""

    def __init__(self, rotation: Array, translation_m: Array, most: int, surfaces: SurfacePair) -> None:
        n = len(rotation)
        self.surfaces = surfaces
        self.rotation, self.translation_m = rotation.copy(), translation_m.copy()
        self.held_back = np.zeros(n, dtype=bool)
        self.wrench, self.residual = np.zeros((n, 6)), np.zeros(n)
        self.forces, self.points = np.zeros((n, most, 3)), np.zeros((n, most, 3))
        self.normal_force = np.zeros((n, most))
        self.near = surfaces.near(self.rotation, self.translation_m, np.full(n, AHEAD_M), most)

    @classmethod
    def touching(cls, rotation: Array, translation_m: Array, most: int, surfaces: SurfacePair) -> _State:
        """At first contact."""
        return cls(rotation, translation_m, most, surfaces)

    def advance(
        self,
        commanded: Array,
        target_m: Array,
        compliance: Array,
        friction: Array,
        stride_m: Array,
        sweeps: int,
        which: NDArray[np.bool_],
    ) -> None:
        """Bring the pegs `which` (N,) to balance with the motor side at (commanded, target_m)."""
        rows = np.flatnonzero(which)
        rotation, translation = self.rotation[rows], self.translation_m[rows]
        inverse = np.swapaxes(rotation, -1, -2)
        free = np.concatenate(
            [
                np.einsum("nij,nj->ni", inverse, target_m[rows] - translation),
                rotation_of(inverse @ commanded[rows]).as_rotvec(),
            ],
            axis=1,
        )
        most = self.forces.shape[1]
        near = self.surfaces.near(rotation, translation, 3.0 * stride_m[rows] + AHEAD_M, most)
        count = max(int(near.present.sum(axis=1).max(initial=0)), 1)
        basis, points = _basis(near, count, rotation, translation)
        c = compliance[rows]
        moved = np.einsum("nij,nmkj->nmki", c, basis)
        delassus = np.einsum("nmka,npla->nmkpl", basis, moved)
        at_rest = np.einsum("nmka,na->nmk", basis, free)
        at_rest[..., 0] += np.where(near.present[:, :count], near.gap_m[:, :count], np.inf)
        guess = self._guess(rows, near, basis, count)
        found = contact_forces(delassus, at_rest, friction[rows], guess, sweeps)
        wrench = np.einsum("nmka,nmk->na", basis, found.forces_n)
        twist = free + np.einsum("nij,nj->ni", c, wrench)
        # The step is limited to the range in which contacts were searched.
        way = np.linalg.norm(twist[:, :3], axis=1) + LEVER_M * np.linalg.norm(twist[:, 3:], axis=1)
        share = np.minimum(1.0, 2.5 * stride_m[rows] / np.maximum(way, 1e-12))
        self.held_back[rows] = share < 1.0
        twist *= share[:, None]
        self.translation_m[rows] = translation + np.einsum("nij,nj->ni", rotation, twist[:, :3])
        self.rotation[rows] = rotation @ Rotation.from_rotvec(twist[:, 3:]).as_matrix()
        self.wrench[rows], self.residual[rows] = wrench, found.residual_n
        self.forces[rows], self.points[rows], self.normal_force[rows] = 0.0, 0.0, 0.0
        self.forces[rows, :count] = np.einsum("nmka,nmk->nma", basis[..., :3], found.forces_n)
        self.points[rows, :count] = points
        self.normal_force[rows, :count] = found.forces_n[..., 0]
        self._remember(rows, near)

    def _guess(self, rows: NDArray[np.intp], near: NearContacts, basis: Array, count: int) -> Array:
        """The last step's forces of the contacts that still exist, along the new normals and tangents."""
        same = (near.key[:, :count, None] == self.near.key[rows][:, None, :]) & near.present[:, :count, None]
        old = np.einsum("nmp,npa->nma", same, self.forces[rows])
        return np.asarray(np.einsum("nmka,nma->nmk", basis[..., :3], old))

    def _remember(self, rows: NDArray[np.intp], near: NearContacts) -> None:
        self.near.present[rows], self.near.gap_m[rows], self.near.key[rows] = near.present, near.gap_m, near.key
        mine, new = self.near.features, near.features
        mine.kind[rows], mine.sign[rows] = new.kind, new.sign
        mine.peg_point_m[rows], mine.peg_direction[rows] = new.peg_point_m, new.peg_direction
        mine.hole_point_m[rows], mine.hole_direction[rows] = new.hole_point_m, new.hole_direction

    def result(self, travel_m: Array) -> PushedPegs:
        """The final poses, wrenches and contact forces."""
        return PushedPegs(
            travel_m, self.rotation, self.translation_m, self.wrench, self.normal_force, self.forces, self.points,
            self.near.features, self.residual,
        )  # fmt: skip


def _basis(near: NearContacts, count: int, rotation: Array, translation: Array) -> tuple[Array, Array]:
    """Wrenches (N, count, 3, 6) of 1 N along each contact's normal and two tangents; points, peg frame."""
    geometry = contact_geometry(near.features[:, :count], rotation[:, None], translation[:, None])
    normal = geometry.normal_peg
    # A tangent perpendicular to the axis along which the normal is smallest never has a length near zero.
    least = np.eye(3)[np.abs(normal).argmin(axis=-1)]
    first = np.cross(normal, least)
    first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    directions = np.stack([normal, first, np.cross(normal, first)], axis=-2)
    moments = np.cross(geometry.point_peg_m[..., None, :], directions)
    present = near.present[:, :count, None, None]
    return np.concatenate([directions, moments], axis=-1) * present, geometry.point_peg_m
