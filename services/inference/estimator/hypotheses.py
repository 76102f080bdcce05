"""Contact hypotheses: which features of peg and hole touched in each push, judged at many trial poses at once.

For a trial pose of the hole every pair of convex pieces offers one contact: the features that would meet first along
the
push. A hypothesis is one or two of these. Its wrench is a nonnegative sum of their bases (Eqs. 21-24), its gaps ought
to
be zero, and no other pair may overlap. The hypothesis of least cost is kept; nothing is assumed to be a wall contact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crosspih_common.geometry.pose import Array
from services.inference.estimator.observation import EstimatorSettings, TouchObservation
from services.inference.mechanics import ContactFeatures, PairTables, contact_geometry, first_contacts
from services.inference.mechanics.contact_wrench import contact_wrench_basis

SECOND_CONTACT_COST = 6.0
NO_CONTACT_COST = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class TouchBatch:
    """T touches as arrays: deflected peg poses in the base frame, wrenches, whitening sds, compliances, motions."""

    rotation: Array
    translation_m: Array
    wrench: Array
    sd: Array
    compliance: Array
    motion_base: Array

    @classmethod
    def of(cls, touches: list[TouchObservation], settings: EstimatorSettings) -> TouchBatch:
        """Stack observations; the model's floors are added to their noise."""
        poses = [touch.deflected_pose_base_peg() for touch in touches]
        wrench = np.array([touch.wrench_peg for touch in touches])
        sd = np.array([touch.wrench_sd for touch in touches])
        magnitude = np.repeat(
            np.column_stack([np.linalg.norm(wrench[:, :3], axis=1), np.linalg.norm(wrench[:, 3:], axis=1)]), 3, axis=1
        )
        floor = np.repeat([settings.force_floor_n, settings.moment_floor_nm], 3)
        return cls(
            np.array([pose.rotation for pose in poses]),
            np.array([pose.translation_m for pose in poses]),
            wrench,
            np.sqrt(sd**2 + floor**2 + (settings.relative_floor * magnitude) ** 2),
            np.array([touch.compliance_peg for touch in touches]),
            np.array([touch.motion_direction_base for touch in touches]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class TrialPoses:
    """K trial poses of the hole in the base frame with a friction coefficient each: (K, 3, 3), (K, 3) m, (K,)."""

    rotation: Array
    translation_m: Array
    friction: Array

    def __getitem__(self, index: Array | NDArray[np.int64] | slice) -> TrialPoses:
        return TrialPoses(self.rotation[index], self.translation_m[index], self.friction[index])

    def moved(self, step: Array) -> TrialPoses:
        """Right perturbation by steps (K, 7): x, y, z, rx, ry, rz, friction."""
        return TrialPoses(
            self.rotation @ Rotation.from_rotvec(step[:, 3:6]).as_matrix(),
            self.translation_m + np.einsum("kij,kj->ki", self.rotation, step[:, :3]),
            np.clip(self.friction + step[:, 6], 0.0, 0.8),
        )


@dataclass(frozen=True, slots=True, eq=False)
class ChosenContacts:
    """The least-cost hypothesis of each (trial, touch): two candidate columns (K, T, 2), which of them press (K, T, 2),
    the cost (K, T), all Q candidates with their gaps (K, T, Q), and which of those overlap but do not press."""

    features: ContactFeatures
    columns: NDArray[np.int64]
    pressing: NDArray[np.bool_]
    overlapping: NDArray[np.bool_]
    cost: Array


def relative_poses(trials: TrialPoses, touches: TouchBatch) -> tuple[Array, Array, Array]:
    """Peg in hole for every (trial, touch): rotation (K, T, 3, 3), translation (K, T, 3) m, motion in the hole
    frame."""
    inverse = np.swapaxes(trials.rotation, -1, -2)[:, None]
    rotation = inverse @ touches.rotation[None]
    offset = touches.translation_m[None] - trials.translation_m[:, None]
    translation = np.einsum("kij,ktj->kti", inverse[:, 0], offset)
    motion = np.einsum("kij,tj->kti", inverse[:, 0], touches.motion_base)
    return rotation, translation, motion


def contact_basis(features: ContactFeatures, trials: TrialPoses, touches: TouchBatch) -> tuple[Array, Array, Array]:
    """Gap (K, T, Q) m, wrench basis (K, T, Q, 6) and contact point (K, T, Q, 3) m of candidate contacts (K, T, Q)."""
    rotation, translation, _ = relative_poses(trials, touches)
    geometry = contact_geometry(features, rotation[:, :, None], translation[:, :, None])
    motion_peg = np.einsum("tji,tj->ti", touches.rotation, touches.motion_base)
    basis = contact_wrench_basis(
        geometry.normal_peg,
        geometry.point_peg_m,
        motion_peg[None, :, None],
        trials.friction[:, None, None],
        touches.compliance[None, :, None],
    )
    return geometry.gap_m, basis, geometry.point_peg_m


def choose_contacts(
    tables: PairTables, trials: TrialPoses, touches: TouchBatch, gap_sd_m: float, wrench_sd: Array
) -> ChosenContacts:
    """The least-cost hypothesis for every trial pose and touch. wrench_sd (T, 6), gap_sd_m: the whitening to use."""
    k, t = len(trials.rotation), len(touches.wrench)
    rotation, translation, motion = relative_poses(trials, touches)
    pairs = first_contacts(tables, rotation.reshape(-1, 3, 3), translation.reshape(-1, 3), motion.reshape(-1, 3))
    q = pairs.travel_m.shape[1]
    shape = (k, t, q)
    source = pairs.features
    features = ContactFeatures(
        source.kind.reshape(shape),
        source.peg_point_m.reshape(*shape, 3),
        source.peg_direction.reshape(*shape, 3),
        source.hole_point_m.reshape(*shape, 3),
        source.hole_direction.reshape(*shape, 3),
        source.sign.reshape(shape),
    )
    meets = np.isfinite(pairs.travel_m).reshape(shape)
    gap, basis, _ = contact_basis(features, trials, touches)
    gap_cost = np.where(meets, (gap / gap_sd_m) ** 2, NO_CONTACT_COST)
    depth = np.minimum(pairs.separation_m.reshape(shape), 0.0)
    overlap_cost = (depth / gap_sd_m) ** 2
    others = overlap_cost.sum(axis=-1)

    target = touches.wrench / wrench_sd
    white = basis / wrench_sd[None, :, None]
    norm = np.einsum("ktqi,ktqi->ktq", white, white)
    along = np.einsum("ktqi,ti->ktq", white, target)
    full = np.einsum("ti,ti->t", target, target)[None, :, None]
    force = np.maximum(along / norm, 0.0)
    single = full - force * along + gap_cost + others[..., None] - overlap_cost

    first, second = np.triu_indices(q, 1)
    cross = np.einsum("ktqi,ktri->ktqr", white, white)[..., first, second]
    n1, n2, a1, a2 = norm[..., first], norm[..., second], along[..., first], along[..., second]
    determinant = n1 * n2 - cross**2
    safe = np.maximum(determinant, 1e-9 * n1 * n2)
    f1, f2 = (n2 * a1 - cross * a2) / safe, (n1 * a2 - cross * a1) / safe
    valid = (determinant > 1e-6 * n1 * n2) & (f1 > 0.0) & (f2 > 0.0)
    double = full - f1 * a1 - f2 * a2 + gap_cost[..., first] + gap_cost[..., second]
    double = double + others[..., None] - overlap_cost[..., first] - overlap_cost[..., second]
    double = np.where(valid, double + SECOND_CONTACT_COST, np.inf)

    best_one, best_two = single.argmin(axis=-1), double.argmin(axis=-1)
    cost_one = np.take_along_axis(single, best_one[..., None], -1)[..., 0]
    cost_two = np.take_along_axis(double, best_two[..., None], -1)[..., 0]
    two = cost_two < cost_one
    columns = np.stack([np.where(two, first[best_two], best_one), np.where(two, second[best_two], best_one)], axis=-1)
    pressing = np.stack([np.ones_like(two), two], axis=-1)
    overlapping = (depth < 0.0) & (gap < 0.0) & meets
    np.put_along_axis(overlapping, columns, False, axis=-1)
    return ChosenContacts(features, columns, pressing, overlapping, np.minimum(cost_one, cost_two))
