"""The estimator on touches made by the mechanics: it finds the hole, says how well, and gates what it cannot
explain."""

import dataclasses

import numpy as np
import pytest

from crosspih_common.geometry import Pose
from crosspih_common.shapes import CrossPeg
from services.inference.estimator import (
    HolePosePrior,
    HolePosterior,
    TouchObservation,
    estimate_pose,
    final_estimate,
)
from services.inference.mechanics import PairTables
from services.inference.touch_choice.by_rule import next_touch
from tests.inference.synthetic_touch import COMPLIANCE, synthetic_touch

PEG = CrossPeg()
HOLE = PEG.hole(1e-4)
TABLES = PairTables.of(PEG, HOLE)
VISION_SD = (2e-4, 2e-4, 6e-4, np.radians(0.6), np.radians(0.6), np.radians(0.1))


def assembly(seed: int, mu: float = 0.1, count: int = 4) -> tuple[Pose, HolePosePrior, list[TouchObservation]]:
    """Truth, prior and arm touches about the prior's mean."""
    rng = np.random.default_rng(seed)
    truth = Pose.from_rotvec(rng.uniform(-2, 2, 3), rng.uniform(-1, 1, 3))
    error = rng.normal(size=6) * VISION_SD
    prior = HolePosePrior.from_sd(truth @ Pose.from_rotvec(error[3:], error[:3]), VISION_SD)
    touches = []
    for made in range(count):
        plan = next_touch(PEG, prior.pose_base_hole, prior.covariance, 2, made)
        touches.append(synthetic_touch(TABLES, truth, plan.pose_base_peg_start, plan.direction_base, mu, rng))
    return truth, prior, touches


def estimate(prior: HolePosePrior, touches: list[TouchObservation]) -> HolePosterior:
    return estimate_pose(TABLES, prior, touches, np.random.default_rng(0))


@pytest.mark.parametrize("seed", range(5))
def test_four_touches_give_the_pose(seed: int) -> None:
    truth, prior, touches = assembly(seed)
    found = estimate(prior, touches)
    left = truth.inverse() @ found.pose_base_hole
    assert np.linalg.norm(left.translation_m[:2]) < 1e-4 and abs(left.translation_m[2]) < 2e-4
    assert np.degrees(np.linalg.norm(left.rotvec_rad())) < 0.8
    assert found.friction_coefficient == pytest.approx(0.1, abs=0.02)
    assert found.rank >= 3 and found.residual_cost < 12.0
    assert all(verdict.used and verdict.contacts for verdict in found.touches)
    error = np.concatenate([left.translation_m, left.rotvec_rad()])
    assert error @ np.linalg.solve(found.covariance, error) < 30.0


def test_estimate_is_deterministic_and_moves_with_the_base() -> None:
    _truth, prior, touches = assembly(7, count=2)
    once, twice = estimate(prior, touches), estimate(prior, touches)
    assert np.array_equal(once.pose_base_hole.matrix(), twice.pose_base_hole.matrix())
    move = Pose.from_rotvec([0.4, -1.0, 0.3], [0.5, 0.1, -0.2])
    moved = estimate(
        HolePosePrior(move @ prior.pose_base_hole, prior.covariance),
        [
            dataclasses.replace(
                touch,
                pose_base_peg=move @ touch.pose_base_peg,
                motion_direction_base=move.rotate(touch.motion_direction_base),
            )
            for touch in touches
        ],
    )
    expected = move @ once.pose_base_hole
    assert moved.pose_base_hole.distance_to_m(expected) < 1e-6
    assert moved.pose_base_hole.angle_to_rad(expected) < 1e-5


def test_without_touches_the_prior_comes_back() -> None:
    _, prior, touches = assembly(1, count=1)
    found = estimate(prior, [dataclasses.replace(touches[0], informative=False)])
    assert found.pose_base_hole is prior.pose_base_hole and found.rank == 0
    assert not found.touches[0].used and found.touches[0].reason == "not informative"


def test_a_wild_touch_is_gated() -> None:
    truth, prior, touches = assembly(2)
    wild = touches[1].wrench_peg.copy()
    wild[3:] += 1.0
    touches[1] = dataclasses.replace(touches[1], wrench_peg=wild)
    found = estimate(prior, touches)
    assert not found.touches[1].used and found.touches[1].reason
    assert np.linalg.norm((truth.inverse() @ found.pose_base_hole).translation_m[:2]) < 1.5e-4


def test_observation_names_a_wrong_shape() -> None:
    _, _, touches = assembly(1, count=1)
    with pytest.raises(ValueError, match="wrench_sd"):
        dataclasses.replace(touches[0], wrench_sd=np.zeros(3))
    with pytest.raises(ValueError, match="unit vector"):
        dataclasses.replace(touches[0], motion_direction_base=np.array([0.0, 0.0, 2.0]))


def test_seated_peg_gives_the_hole_within_the_clearance() -> None:
    truth = Pose.from_rotvec([0.1, 0.2, 0.3], [0.4, 0.0, 0.6])
    prior = HolePosePrior.from_sd(truth @ Pose.from_rotvec([0.01, -0.01, 0.002], [3e-4, -2e-4, 2e-4]), VISION_SD)
    depth = PEG.taper_start_m - HOLE.chamfer_m - 0.015
    seated = truth @ Pose.from_translation([5e-5, -5e-5, -depth])
    pose, covariance = final_estimate(
        PEG, HOLE, prior.pose_base_hole, prior.covariance, seated, np.zeros(6), COMPLIANCE
    )
    left = truth.inverse() @ pose
    assert np.linalg.norm(left.translation_m[:2]) < 1e-4
    assert np.degrees(np.linalg.norm(left.rotvec_rad())) < 0.35
    assert np.all(np.sqrt(np.diag(covariance))[[0, 1, 3, 4]] < np.array(VISION_SD)[[0, 1, 3, 4]])
    with pytest.raises(ValueError, match="short of the bore"):
        final_estimate(
            PEG, HOLE, truth, prior.covariance, truth @ Pose.from_translation([0, 0, -0.08]), np.zeros(6), COMPLIANCE
        )


def test_next_touch_aims_then_goes_round_the_arms() -> None:
    hole = Pose.from_rotvec([0.1, 0.0, 0.0], [0.5, 0.0, 0.5])
    wide, narrow = np.diag([1e-5] * 3 + [1e-3] * 3), np.diag([1e-8] * 3 + [1e-5] * 3)
    straight = next_touch(PEG, hole, wide, failed_pushes=0, touches_made=0)
    assert straight.idea == "estimate"
    assert straight.direction_base == pytest.approx(hole.rotation[:, 2])
    ideas = [next_touch(PEG, hole, narrow, 0, made).idea for made in range(5)]
    assert ideas == ["arm 1", "arm 2", "arm 3", "arm 4", "arm 1"]
    assert next_touch(PEG, hole, wide, 2, 0).idea == "arm 1"
    assert next_touch(PEG, hole, wide, 0, 0, last_touch_used=False).idea == "arm 1"
    tip = hole.inverse().apply(straight.pose_base_peg_start.apply([0.0, 0.0, PEG.tip_m]))
    assert tip[2] < -0.004
