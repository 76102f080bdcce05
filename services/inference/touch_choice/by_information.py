"""The next touch by expected information: the push that is expected to narrow the posterior most.

For each candidate and for holes drawn from the posterior, the mechanics predict the first contact, and how the force's
direction, its line and the travel change with the hole's pose. The Gauss-Newton information of that touch, added to the
posterior's, gives the remaining uncertainty (Lindley 1956). A draw in which a candidate misses adds nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Peg
from services.inference.mechanics import PairTables, contact_geometry, contact_wrench_basis, first_contacts
from services.inference.touch_choice.by_rule import ArmPattern, PlannedTouch, arm_touch, arms_of

STEP = 1e-6
WITHOUT_DEPTH = np.array([0, 1, 3, 4, 5])


@dataclass(frozen=True, slots=True)
class InformedSettings:
    """holes: drawn from the posterior. gap_sd_m, force_sd_n, moment_sd_nm: accuracy of a touch at force_n.

    reach_m: travel beyond which a touch counts as missed.
    """

    holes: int = 24
    gap_sd_m: float = 4e-5
    force_sd_n: float = 0.05
    moment_sd_nm: float = 0.0025
    force_n: float = 6.0
    reach_m: float = 0.045


def candidates(
    peg: Peg, pose_base_hole: Pose, covariance: Array, standoff_m: float = 0.004, pattern: ArmPattern | None = None
) -> list[PlannedTouch]:
    """Straight touches, and touches about the outline: each part first, turned either way, as it is, tilted, or
    shifted."""
    pattern = pattern or ArmPattern()
    standoff_m = standoff_m + 2.5 * float(np.sqrt(covariance[2, 2]))
    ahead = Pose.from_translation([0.0, 0.0, -standoff_m - peg.tip_m])
    plans = [PlannedTouch(pose_base_hole @ ahead, pose_base_hole.rotation[:, 2].copy(), "estimate")]
    variants = (
        pattern,
        ArmPattern(pattern.shift_m, pattern.turn_rad, 0.04, pattern.largest_shift_m, pattern.largest_turn_rad),
        ArmPattern(pattern.shift_m, pattern.turn_rad, -0.04, pattern.largest_shift_m, pattern.largest_turn_rad),
    )
    for arm in range(arms_of(peg)):
        for sense in (1.0, -1.0):
            for variant in variants:
                plans.append(arm_touch(peg, pose_base_hole, covariance, arm, sense, standoff_m, variant))
    return plans


def informed_touch(
    tables: PairTables,
    plans: list[PlannedTouch],
    pose_base_hole: Pose,
    covariance: Array,
    compliance_peg: Array,
    friction: float,
    rng: np.random.Generator,
    settings: InformedSettings | None = None,
) -> tuple[PlannedTouch, Array]:
    """The best plan, and for each plan (C,) the expected log-determinant of the remaining covariance, without the
    depth."""
    settings = settings or InformedSettings()
    covariance = 0.5 * (covariance + covariance.T)
    holes = settings.holes
    # the same holes for every plan, so that only the plans differ; drawn in opposite pairs, so that their mean is zero
    half = rng.normal(size=(holes // 2, 6)) @ np.linalg.cholesky(covariance).T
    step = np.concatenate([half, -half])
    rotation = pose_base_hole.rotation @ Rotation.from_rotvec(step[:, 3:]).as_matrix()
    position = pose_base_hole.translation_m + step[:, :3] @ pose_base_hole.rotation.T
    back = np.swapaxes(rotation, -1, -2)
    start_r = np.array([plan.pose_base_peg_start.rotation for plan in plans])
    start_t = np.array([plan.pose_base_peg_start.translation_m for plan in plans])
    motion = np.array([plan.direction_base for plan in plans])
    count, each = len(plans), len(step)
    turned = np.einsum("hij,cjk->chik", back, start_r).reshape(-1, 3, 3)
    shifted = np.einsum("hij,chj->chi", back, start_t[:, None] - position[None]).reshape(-1, 3)
    along = np.einsum("hij,cj->chi", back, motion).reshape(-1, 3)
    pairs = first_contacts(tables, turned, shifted, along)
    first = pairs.travel_m.argmin(axis=1)
    rows = np.arange(len(first))
    travel = pairs.travel_m[rows, first]
    felt = np.isfinite(travel) & (travel > -0.002) & (travel < settings.reach_m)
    shifted = shifted + np.where(felt, travel, 0.0)[:, None] * along

    steps = np.vstack([np.zeros(6), np.eye(6) * STEP])
    by_turn = Rotation.from_rotvec(-steps[:, 3:]).as_matrix()
    # a right perturbation of the hole moves the peg the opposite way in the hole's frame
    moved_r = np.einsum("sij,njk->nsik", by_turn, turned)
    moved_t = np.einsum("sij,nsj->nsi", by_turn, shifted[:, None] - steps[None, :, :3])
    features = pairs.features[rows, first][:, None]
    geometry = contact_geometry(features, moved_r, moved_t)
    motion_peg = np.einsum("nji,nj->ni", turned, along)
    basis = contact_wrench_basis(
        geometry.normal_peg, geometry.point_peg_m, motion_peg[:, None], np.array(friction), compliance_peg
    )
    unit = settings.force_n * basis / np.linalg.norm(basis[..., :3], axis=-1, keepdims=True)
    white = unit / np.repeat([settings.force_sd_n, settings.moment_sd_nm], 3)
    change = (white[:, 1:] - white[:, :1]) / STEP
    here = white[:, 0] / np.linalg.norm(white[:, 0], axis=-1, keepdims=True)
    # the force's size is not predicted, so a change that only scales the wrench carries no information
    change = change - np.einsum("nsi,ni->ns", change, here)[..., None] * here[:, None]
    gap = (geometry.gap_m[:, 1:] - geometry.gap_m[:, :1]) / (STEP * settings.gap_sd_m)
    jacobian = np.concatenate([change, gap[..., None]], axis=-1) * felt[:, None, None]
    information = np.einsum("nsi,nri->nsr", jacobian, jacobian) + np.linalg.inv(covariance)
    left = np.linalg.inv(information)[:, WITHOUT_DEPTH[:, None], WITHOUT_DEPTH]
    score = np.linalg.slogdet(left)[1].reshape(count, each).mean(axis=1)
    return plans[int(score.argmin())], np.asarray(score)
