"""The posterior over several contacts and outlines, its honesty on a few trials, and touches chosen by information."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from crosspih_common.geometry import Pose
from crosspih_common.shapes import CrossPeg, Outline, Peg
from services.inference.estimator import EstimatorSettings, HolePosePrior, estimate_pose
from services.inference.estimator.coverage import TouchRecord, TrialSettings, run_trial, summary
from services.inference.estimator.hypotheses import TouchBatch, TrialPoses
from services.inference.estimator.synthetic import complementarity, settle, touch
from services.inference.mechanics import PairTables
from services.inference.touch_choice.by_information import candidates, informed_touch
from services.inference.touch_choice.by_rule import arms_of, next_touch

PEG = CrossPeg()
TABLES = PairTables.of(PEG, PEG.hole(1e-4))
COMPLIANCE = np.diag([1e-5] * 3 + [1e-3] * 3)
NOMINAL = Pose.from_rotvec([0.3, -0.5, 1.0], [0.4, -0.3, 0.2])
POOR_SD = (1e-3, 1e-3, 2e-3, 0.04, 0.04, 0.01)


@settings(max_examples=30, deadline=None)
@given(
    arrays(np.float64, (4, 6), elements=st.floats(-1.0, 1.0, allow_subnormal=False)),
    arrays(np.float64, 4, elements=st.floats(-1.0, 1.0, allow_subnormal=False)),
)
def test_complementarity_holds(rows: np.ndarray, offset: np.ndarray) -> None:
    """No force pulls, no gap is negative, and where there is a gap there is no force."""
    matrix = 0.1 * rows @ rows.T + 0.5 * np.eye(4)
    force = complementarity(matrix, offset)
    gap = matrix @ force + offset
    assert np.all(force >= 0.0)
    assert np.all(gap > -1e-6)
    assert float(np.abs(force * gap).max()) < 1e-6


def test_pushing_on_a_symmetric_peg_presses_many_walls_and_is_understood() -> None:
    """Turned about its axis alone a cross touches with four arms at once: no one contact explains that. Two opposite
    ones do, for their wrench is the same, and the estimator says no more than it can know."""
    truth = NOMINAL
    turned = Pose.from_rotvec([0.0, 0.0, 0.03], np.zeros(3))
    start = truth @ turned @ Pose.from_translation([0.0, 0.0, -0.004 - PEG.tip_m])
    felt = touch(TABLES, truth, start, truth.rotation[:, 2], COMPLIANCE, 0.1, np.random.default_rng(0))
    assert felt is not None and felt.contacts >= 3
    prior = HolePosePrior.from_sd(truth, (2e-4, 2e-4, 6e-4, 0.01, 0.01, 0.02))
    several = estimate_pose(TABLES, prior, [felt.observation], np.random.default_rng(0))
    assert several.touches[0].used
    assert len(several.touches[0].contacts) >= 2
    assert several.touches[0].cost < 20.0
    one = estimate_pose(TABLES, prior, [felt.observation], np.random.default_rng(0), EstimatorSettings(contacts=1))
    assert not one.touches[0].used or one.touches[0].cost > several.touches[0].cost


def test_settled_wrench_balances_the_wrist() -> None:
    """Pushed on past the first contact the force grows, and the peg bends by just as much as the wrist gives way."""
    start = Pose.from_rotvec([0.02, -0.01, 0.03], [0.0005, 0.0, 0.0])
    along = np.array([0.0, 0.0, 1.0])
    forces = []
    for travel in np.arange(0.015, 0.05, 0.0005):
        pose = Pose(start.rotation, start.translation_m + np.array([0.0, 0.0, travel - 0.1]))
        wrench, contacts = settle(TABLES, pose, along, COMPLIANCE, 0.1)
        forces.append(float(np.linalg.norm(wrench[:3])))
        if forces[-1] > 30.0:
            assert contacts >= 1 and wrench[2] < 0.0
            break
    assert forces[0] == 0.0 and forces[-1] > 30.0
    assert np.all(np.diff(forces) > -0.5)


def trials(count: int, touches: int, first: int = 0) -> list[TouchRecord]:
    settings_of_trial = TrialSettings(POOR_SD, touches)

    def policy(belief: Pose, covariance: np.ndarray, made: int, used: bool) -> tuple[Pose, np.ndarray]:
        plan = next_touch(PEG, belief, covariance, made, made, last_touch_used=used)
        return plan.pose_base_peg_start, plan.direction_base

    runs = (
        run_trial(TABLES, NOMINAL, COMPLIANCE, policy, EstimatorSettings(), settings_of_trial, seed)
        for seed in range(first, first + count)
    )
    return list(itertools.chain.from_iterable(runs))


def test_the_region_holds_the_truth_in_most_trials() -> None:
    """Five trials of two touches; the share over 1,000 is measured by `python -m services.inference.estimator`."""
    rows = summary(trials(5, 2))
    assert [row.touches for row in rows] == [1, 2]
    for row in rows:
        assert row.covered["without depth"][0] >= 0.6
        assert row.nees_p50_p95["without depth"][0] < 9.0
    assert rows[1].lateral_mm[0] < rows[0].lateral_mm[0]


def test_candidates_cover_the_outline_and_the_choice_narrows_most() -> None:
    covariance = np.diag(np.square(POOR_SD))
    plans = candidates(PEG, NOMINAL, covariance)
    assert plans[0].idea == "estimate" and len(plans) == 1 + 4 * 2 * 3
    best, score = informed_touch(TABLES, plans, NOMINAL, covariance, COMPLIANCE, 0.1, np.random.default_rng(0))
    before = np.linalg.slogdet(covariance[np.ix_([0, 1, 3, 4, 5], [0, 1, 3, 4, 5])])[1]
    assert score.shape == (len(plans),)
    assert np.all(score <= before + 1e-9)
    assert best is plans[int(score.argmin())] and score.min() < before - 4.0
    again, _ = informed_touch(TABLES, plans, NOMINAL, covariance, COMPLIANCE, 0.1, np.random.default_rng(0))
    assert again is best


def hexagon() -> Peg:
    angle = np.arange(6) * np.pi / 3
    outline = Outline.of("hexagon", 0.024 * np.column_stack([np.cos(angle), np.sin(angle)]), 6)
    return Peg(outline, 0.012, 0.0537, 0.0897, 0.0797)


def test_another_outline_is_touched_and_estimated() -> None:
    peg = hexagon()
    tables = PairTables.of(peg, peg.hole(1e-4))
    assert arms_of(peg) == 6
    sd = (2e-4, 2e-4, 6e-4, 0.01, 0.01, 0.005)
    rng = np.random.default_rng(3)
    error = rng.normal(size=6) * sd
    prior = HolePosePrior.from_sd(NOMINAL @ Pose.from_rotvec(error[3:], error[:3]), sd)
    made = []
    for index in range(3):
        plan = next_touch(peg, prior.pose_base_hole, prior.covariance, 2, 2 * index)
        felt = touch(tables, NOMINAL, plan.pose_base_peg_start, plan.direction_base, COMPLIANCE, 0.1, rng)
        assert felt is not None
        made.append(felt.observation)
    found = estimate_pose(tables, prior, made, np.random.default_rng(0))
    left = found.pose_base_hole.inverse() @ NOMINAL
    off = np.concatenate([left.translation_m, left.rotvec_rad()])
    assert sum(verdict.used for verdict in found.touches) >= 2
    assert np.hypot(*off[:2]) < np.hypot(*error[:2])
    assert off @ np.linalg.solve(found.covariance, off) < 25.0


@pytest.mark.parametrize("seed", [1, 2])
def test_a_face_touch_gives_depth_and_leaves_the_place_open(seed: int) -> None:
    """Nine millimetres beside the hole the tip meets the face: that says how deep the face is, and nothing lateral."""
    sd = (3e-3, 3e-3, 5e-3, 0.03, 0.03, 0.03)
    truth = NOMINAL @ Pose.from_rotvec([0.01, -0.02, 0.0], [0.011, 0.011, 0.004])
    prior = HolePosePrior.from_sd(NOMINAL @ Pose.from_translation([0.002, 0.002, 0.0]), sd)
    start = prior.pose_base_hole @ Pose.from_translation([0.0, 0.0, -0.02 - PEG.tip_m])
    felt = touch(TABLES, truth, start, prior.pose_base_hole.rotation[:, 2], COMPLIANCE, 0.1, np.random.default_rng(1))
    assert felt is not None
    found = estimate_pose(TABLES, prior, [felt.observation], np.random.default_rng(seed))
    assert found.touches[0].used
    assert np.all(found.sd[:2] > 1e-3) and found.sd[2] < 1e-3
    left = found.pose_base_hole.inverse() @ truth
    off = np.concatenate([left.translation_m, left.rotvec_rad()])
    assert off @ np.linalg.solve(found.covariance, off) < 25.0


def test_trial_poses_join_and_slip() -> None:
    one = TrialPoses(np.eye(3)[None], np.zeros((1, 3)), np.array([0.1]))
    rng = np.random.default_rng(0)
    both = TrialPoses.joined([one, one.slipping(2, 3e-5, rng)])
    assert both.slip is not None and both.slip.shape == (2, 2, 6)
    assert np.all(both.slip[0] == 0.0) and np.any(both.slip[1] != 0.0)
    moved = both.moved(np.zeros((2, 7)))
    assert moved.slip is both.slip


def test_touches_can_be_picked() -> None:
    start = NOMINAL @ Pose.from_translation([0.001, 0.0, -0.004 - PEG.tip_m])
    felt = touch(TABLES, NOMINAL, start, NOMINAL.rotation[:, 2], COMPLIANCE, 0.1, np.random.default_rng(0))
    assert felt is not None
    batch = TouchBatch.of([felt.observation] * 3, EstimatorSettings())
    assert batch.picked(np.array([0, 2])).wrench.shape == (2, 6)
