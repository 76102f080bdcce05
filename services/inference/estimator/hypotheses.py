"""Contact hypotheses: which features of peg and hole touched in each push, evaluated at many trial poses at once.

For a trial pose of the hole every pair of convex pieces offers one contact: the features that would meet first along
the push. A hypothesis is one to four of these. Its wrench is a nonnegative sum of their bases (Eqs. 21-24), its gaps
should be zero, and no other pair may overlap. The hypothesis of least cost is kept. Wall contacts are not assumed: the
tip on the face and the taper on the chamfer are pairs of pieces like any other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crosspih_common.geometry.pose import Array
from services.inference.estimator.observation import EstimatorSettings, TouchObservation
from services.inference.mechanics import (
    ContactFeatures,
    ContactGeometry,
    PairTables,
    contact_geometry,
    contact_wrench_basis,
    first_contacts,
)

NO_CONTACT_COST = 1e6
MAX_CLAMPING = 3.0  # limit of one contact's force when several press, times the force of the touch
SLIP_LEVER_M = 0.02  # lever that converts an error of position into one of rotation


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

    def picked(self, index: NDArray[np.intp]) -> TouchBatch:
        """The touches of an index array."""
        return TouchBatch(
            self.rotation[index],
            self.translation_m[index],
            self.wrench[index],
            self.sd[index],
            self.compliance[index],
            self.motion_base[index],
        )


@dataclass(frozen=True, slots=True, eq=False)
class TrialPoses:
    """K trial poses of the hole in the base frame with a friction coefficient each: (K, 3, 3), (K, 3) m, (K,).

    slip (K, T, 6): a small motion of the peg (m, rad, hole frame); the touching features are evaluated with it and with
    its opposite. Where two features are about to touch, an error of some hundredths of a millimetre decides between
    them, and a line against a plane may press at both its ends. None: no such motion.
    """

    rotation: Array
    translation_m: Array
    friction: Array
    slip: Array | None = None

    def __getitem__(self, index: Array | NDArray[np.int64] | slice) -> TrialPoses:
        slip = None if self.slip is None else self.slip[index]
        return TrialPoses(self.rotation[index], self.translation_m[index], self.friction[index], slip)

    def moved(self, step: Array) -> TrialPoses:
        """Right perturbation by steps (K, 7): x, y, z, rx, ry, rz, friction."""
        return TrialPoses(
            self.rotation @ Rotation.from_rotvec(step[:, 3:6]).as_matrix(),
            self.translation_m + np.einsum("kij,kj->ki", self.rotation, step[:, :3]),
            np.clip(self.friction + step[:, 6], 0.0, 0.8),
            self.slip,
        )

    def slipping(self, touches: int, sd_m: float, rng: np.random.Generator) -> TrialPoses:
        """The same trials with random slips for all touches."""
        slip = rng.normal(size=(len(self.friction), touches, 6)) * np.repeat([sd_m, sd_m / SLIP_LEVER_M], 3)
        return TrialPoses(self.rotation, self.translation_m, self.friction, slip)

    @classmethod
    def joined(cls, parts: list[TrialPoses]) -> TrialPoses:
        """All trials in one; the slip is None only if all parts have none."""
        slips = [part.slip for part in parts]
        shape = next((slip.shape[1:] for slip in slips if slip is not None), None)
        filled = None
        if shape is not None:
            filled = np.concatenate([np.zeros((len(p.friction), *shape)) if p.slip is None else p.slip for p in parts])
        return cls(
            np.concatenate([part.rotation for part in parts]),
            np.concatenate([part.translation_m for part in parts]),
            np.concatenate([part.friction for part in parts]),
            filled,
        )


@dataclass(frozen=True, slots=True, eq=False)
class ChosenContacts:
    """The least-cost hypothesis of each (trial, touch): columns (K, T, C) of its contacts among the Q candidates, which
    of them press (K, T, C), the cost (K, T), the candidates' features (K, T, Q), which of those overlap but do not
    press, and which pair of pieces each is (K, T, Q)."""

    features: ContactFeatures
    columns: NDArray[np.int64]
    pressing: NDArray[np.bool_]
    overlapping: NDArray[np.bool_]
    cost: Array
    pair: NDArray[np.int64]


def relative_poses(trials: TrialPoses, touches: TouchBatch) -> tuple[Array, Array, Array]:
    """Peg in hole for every (trial, touch): rotation (K, T, 3, 3), translation (K, T, 3) m, motion in the hole
    frame."""
    inverse = np.swapaxes(trials.rotation, -1, -2)[:, None]
    rotation = inverse @ touches.rotation[None]
    offset = touches.translation_m[None] - trials.translation_m[:, None]
    translation = np.einsum("kij,ktj->kti", inverse[:, 0], offset)
    motion = np.einsum("kij,tj->kti", inverse[:, 0], touches.motion_base)
    return rotation, translation, motion


def candidate_geometry(features: ContactFeatures, trials: TrialPoses, touches: TouchBatch) -> ContactGeometry:
    """Gap, normal and point of candidate contacts (K, T, Q), in the peg frame."""
    rotation, translation, _ = relative_poses(trials, touches)
    return contact_geometry(features, rotation[:, :, None], translation[:, :, None])


def contact_basis(geometry: ContactGeometry, trials: TrialPoses, touches: TouchBatch) -> Array:
    """The wrench bases (K, T, Q, 6) of candidate contacts."""
    motion_peg = np.einsum("tji,tj->ti", touches.rotation, touches.motion_base)
    return contact_wrench_basis(
        geometry.normal_peg,
        geometry.point_peg_m,
        motion_peg[None, :, None],
        trials.friction[:, None, None],
        touches.compliance[None, :, None],
    )


def choose_contacts(
    tables: PairTables,
    trials: TrialPoses,
    touches: TouchBatch,
    gap_sd_m: float,
    wrench_sd: Array,
    settings: EstimatorSettings,
) -> ChosenContacts:
    """The least-cost hypothesis for every trial pose and touch. wrench_sd (T, 6), gap_sd_m: the whitening to use."""
    k, t = len(trials.rotation), len(touches.wrench)
    rotation, translation, motion = relative_poses(trials, touches)
    found = []
    for sign in (1.0,) if trials.slip is None else (1.0, -1.0):
        turned, shifted, along = _slipped(trials, sign, rotation, translation, motion)
        found.append(first_contacts(tables, turned, shifted, along))
    # Only the pairs that meet first, or that penetrate the most, can press or overlap.
    count = min(settings.candidates // len(found), found[0].travel_m.shape[1])
    pair = np.concatenate(
        [np.sort(np.argpartition(one.travel_m, count - 1, axis=-1)[:, :count], axis=-1) for one in found], axis=-1
    )
    shape = (k, t, count * len(found))
    features = _gathered([one.features for one in found], pair, count, shape)
    meets = np.take_along_axis(np.isfinite(found[0].travel_m) | np.isfinite(found[-1].travel_m), pair, -1)
    depth = np.minimum(np.maximum(found[0].separation_m, found[-1].separation_m), 0.0)
    depth = np.where(np.isfinite(found[0].travel_m) | np.isfinite(found[-1].travel_m), depth, 0.0)
    others = ((depth / gap_sd_m) ** 2).sum(axis=-1).reshape(k, t)
    meets, depth = meets.reshape(shape), np.take_along_axis(depth, pair, axis=-1).reshape(shape)
    geometry = candidate_geometry(features, trials, touches)
    basis = contact_basis(geometry, trials, touches)
    # The cost of a contact by itself: its gap, which then is no overlap.
    own = np.where(meets, (geometry.gap_m / gap_sd_m) ** 2 - (depth / gap_sd_m) ** 2, NO_CONTACT_COST)
    columns, pressing, cost = _least_cost(
        touches.wrench / wrench_sd,
        basis / wrench_sd[None, :, None],
        own,
        np.log(gap_sd_m / _normal_compliance(geometry, touches)),
        MAX_CLAMPING * np.linalg.norm(touches.wrench[:, :3], axis=1) + 1.0,
        min(settings.contacts, shape[2]),
    )
    overlapping = (depth < 0.0) & (geometry.gap_m < 0.0) & meets
    at = np.where(pressing, columns, columns[..., :1])
    np.put_along_axis(overlapping, at, False, axis=-1)
    return ChosenContacts(features, columns, pressing, overlapping, cost + others, pair.reshape(shape))


def _slipped(
    trials: TrialPoses, sign: float, rotation: Array, translation: Array, motion: Array
) -> tuple[Array, Array, Array]:
    """Peg in hole (K T, 3, 3), (K T, 3) and motion (K T, 3) with the trials' slip one way (1) or the other (-1)."""
    flat_r, flat_t = rotation.reshape(-1, 3, 3), translation.reshape(-1, 3)
    if trials.slip is not None:
        slip = sign * trials.slip.reshape(-1, 6)
        turn = Rotation.from_rotvec(slip[:, 3:]).as_matrix()
        flat_r, flat_t = turn @ flat_r, np.einsum("nij,nj->ni", turn, flat_t) + slip[:, :3]
    return flat_r, flat_t, motion.reshape(-1, 3)


def _gathered(
    sources: list[ContactFeatures], pair: NDArray[np.int64], count: int, shape: tuple[int, int, int]
) -> ContactFeatures:
    """The features of the chosen pairs (N, count of each source), shaped (K, T, Q)."""
    rows = np.arange(len(pair))[:, None]
    parts = [source[rows, pair[:, i * count : (i + 1) * count]] for i, source in enumerate(sources)]

    def joined(name: str, *more: int) -> Any:
        return np.concatenate([getattr(part, name) for part in parts], axis=1).reshape(*shape, *more)

    return ContactFeatures(
        joined("kind"),
        joined("peg_point_m", 3),
        joined("peg_direction", 3),
        joined("hole_point_m", 3),
        joined("hole_direction", 3),
        joined("sign"),
    )


def _normal_compliance(geometry: ContactGeometry, touches: TouchBatch) -> Array:
    """The compliance of the wrist at each contact point (K, T, Q) along its normal, m/N."""
    normal = np.concatenate([geometry.normal_peg, np.cross(geometry.point_peg_m, geometry.normal_peg)], axis=-1)
    gives = np.einsum("tij,ktqj->ktqi", touches.compliance, normal)
    return np.asarray(np.maximum(np.einsum("ktqi,ktqi->ktq", normal, gives), 1e-9))


def _least_cost(
    target: Array, white: Array, own: Array, log_gap_per_compliance: Array, strongest_n: Array, most: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_], Array]:
    """Contacts (K, T, most) that explain whitened wrenches (T, 6) best, which of them press, and their cost (K, T).

    white (K, T, Q, 6): whitened wrench bases; own (K, T, Q): cost of each contact by itself. The best contact and the
    best pair are found exactly; more are added one by one while the cost falls. Each contact past the first pays a
    penalty from its likelihood: given the pose, the wrist's compliance c turns its gap, known to sd s, into its force,
    known to sd f from the wrench, so that a fitted force costs 2 ln(s / (c f)). With several contacts, none presses
    with more than strongest_n (T,): the wrist that holds the peg can clamp it only so hard.
    """
    k, t, q, _ = white.shape
    norm = np.einsum("ktqi,ktqi->ktq", white, white)
    along = np.einsum("ktqi,ti->ktq", white, target)
    full = np.einsum("ti,ti->t", target, target)[None, :, None]
    single = full - np.maximum(along, 0.0) * along / norm + own
    best_one = single.argmin(axis=-1)[..., None]
    cost = np.take_along_axis(single, best_one, -1)[..., 0]
    columns = np.repeat(best_one, most, axis=-1)
    pressing = np.zeros((k, t, most), dtype=bool)
    pressing[..., 0] = True
    if most < 2:
        return columns, pressing, cost

    first, second = np.triu_indices(q, 1)
    cross = np.einsum("ktqi,ktri->ktqr", white, white)[..., first, second]
    n1, n2, a1, a2 = norm[..., first], norm[..., second], along[..., first], along[..., second]
    determinant = n1 * n2 - cross**2
    safe = np.maximum(determinant, 1e-9 * n1 * n2)
    f1, f2 = (n2 * a1 - cross * a2) / safe, (n1 * a2 - cross * a1) / safe
    valid = (determinant > 1e-6 * n1 * n2) & (f1 > 0.0) & (f2 > 0.0)
    valid &= np.maximum(f1, f2) < strongest_n[None, :, None]
    # the squares of the forces' sds are n2 / determinant and n1 / determinant; the mean of both views
    by_first = log_gap_per_compliance[..., first]
    by_second = log_gap_per_compliance[..., second]
    extra = np.maximum(0.0, by_first + by_second + np.log(safe) - 0.5 * np.log(n1 * n2))
    double = full - f1 * a1 - f2 * a2 + own[..., first] + own[..., second] + extra
    double = np.where(valid, double, np.inf)
    best_two = double.argmin(axis=-1)
    cost_two = np.take_along_axis(double, best_two[..., None], -1)[..., 0]
    two = cost_two < cost
    cost = np.where(two, cost_two, cost)
    columns[..., 0] = np.where(two, first[best_two], columns[..., 0])
    columns[..., 1] = np.where(two, second[best_two], columns[..., 0])
    pressing[..., 1] = two
    for index in range(2, most):
        grown = _grown(target, white, own, log_gap_per_compliance, strongest_n, columns, pressing, cost, index)
        if grown is None:
            break
        columns[..., index], pressing[..., index], cost = grown
    return columns, pressing, cost


def _grown(
    target: Array,
    white: Array,
    own: Array,
    log_gap_per_compliance: Array,
    strongest_n: Array,
    columns: NDArray[np.int64],
    pressing: NDArray[np.bool_],
    cost: Array,
    index: int,
) -> tuple[NDArray[np.int64], NDArray[np.bool_], Array] | None:
    """One more contact where it lowers the cost: column, whether, and cost (K, T); None where it never does."""
    rows = np.argwhere(pressing[..., index - 1])
    if not len(rows):
        return None
    at_k, at_t = rows[:, 0], rows[:, 1]
    candidates = white[at_k, at_t]
    chosen = np.take_along_axis(candidates, columns[at_k, at_t, :index, None], axis=1)
    gram = chosen @ np.swapaxes(chosen, -1, -2)
    gram = gram + 1e-9 * np.einsum("nii->n", gram)[:, None, None] * np.eye(index)
    shares = np.linalg.solve(gram, chosen @ np.swapaxes(candidates, -1, -2))
    across = candidates - np.swapaxes(shares, -1, -2) @ chosen
    force = np.linalg.solve(gram, np.einsum("nci,ni->nc", chosen, target[at_t])[..., None])
    left = target[at_t] - np.einsum("nc,nci->ni", force[..., 0], chosen)
    norm = np.einsum("nqi,nqi->nq", across, across)
    whole = np.einsum("nqi,nqi->nq", candidates, candidates)
    more = np.einsum("nqi,ni->nq", across, left)
    new_force = more / np.maximum(norm, 1e-30)
    rest = force - shares * new_force[:, None]
    valid = (norm > 1e-4 * whole) & (new_force > 0.0) & np.all(rest > 0.0, axis=1)
    valid &= np.maximum(rest.max(axis=1), new_force) < strongest_n[at_t][:, None]
    extra = np.maximum(0.0, 2.0 * log_gap_per_compliance[at_k, at_t] + np.log(np.maximum(norm, 1e-30)))
    change = np.where(valid, own[at_k, at_t] + extra - more * new_force, np.inf)
    best = change.argmin(axis=1)
    gain = np.take_along_axis(change, best[:, None], axis=1)[:, 0]
    taken = gain < 0.0
    column = columns[..., index].copy()
    pressed = np.zeros(column.shape, dtype=bool)
    column[at_k[taken], at_t[taken]] = best[taken]
    pressed[at_k[taken], at_t[taken]] = True
    lower = cost.copy()
    lower[at_k[taken], at_t[taken]] += gain[taken]
    return column, pressed, lower
