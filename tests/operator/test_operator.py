"""The operator's pure parts: scoring, statistics, and the documentation that derives from the key table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import AssemblyResult, PoseData, SimulationTruth, Strategy
from services.operator.contract.keys_table import markdown
from services.operator.dataset.contact import draw_pose_peg_hole, start_pose_hole_peg
from services.operator.scoring.score import TrialFigures, insertion_depth_m, pose_error, score
from services.operator.scoring.statistics import summarise, wilson95

HOLE = Workcell().hole_prior.pose_base_hole()


def test_the_documented_keys_are_the_keys() -> None:
    page = Path("docs/keys.md").read_text(encoding="utf-8")
    assert page == markdown(), "make it anew: crosspih keys --markdown > docs/keys.md"


@given(st.integers(0, 3), st.floats(-0.01, 0.01), st.floats(-0.01, 0.01), st.floats(-0.01, 0.01), st.floats(0, 0.3))
def test_errors_are_told_apart_and_a_cross_has_four_sides(
    quarter: int, x: float, y: float, z: float, tilt: float
) -> None:
    estimate = HOLE @ Pose.from_translation([x, y, z]) @ Pose.from_rotvec([tilt, 0.0, 0.0], np.zeros(3))
    estimate = estimate @ Pose.from_rotvec([0.0, 0.0, quarter * np.pi / 2], np.zeros(3))
    error = pose_error(estimate, HOLE)
    assert error.lateral_mm == pytest.approx(np.hypot(x, y) * 1e3, abs=1e-9)
    assert error.depth_mm == pytest.approx(z * 1e3, abs=1e-9)
    assert error.tilt_deg == pytest.approx(np.rad2deg(tilt), abs=1e-4)
    assert error.rotation_deg == pytest.approx(np.rad2deg(tilt), abs=1e-4)


def test_depth_counts_the_body_past_the_inner_rim() -> None:
    workcell = Workcell()
    peg = workcell.peg.shape()
    at_rim = HOLE @ Pose.from_translation([0.0, 0.0, 0.001 - peg.taper_start_m])
    assert insertion_depth_m(workcell, at_rim, HOLE) == pytest.approx(0.0, abs=1e-12)
    assert insertion_depth_m(workcell, at_rim @ Pose.from_translation([0, 0, 0.015]), HOLE) == pytest.approx(0.015)


def _result(depth_m: float, inserted: bool = True) -> tuple[AssemblyResult, SimulationTruth]:
    peg = Workcell().peg.shape()
    pose_base_peg = HOLE @ Pose.from_translation([0.0, 0.0, 0.001 + depth_m - peg.taper_start_m])
    result = AssemblyResult(
        assembly_id="a",
        strategy=Strategy.FUSED,
        inserted=inserted,
        failure=None,
        backed_off=False,
        pose_base_hole=PoseData.of(HOLE),
        pose_base_peg=PoseData.of(pose_base_peg),
        vision_pose_base_hole=PoseData.of(HOLE @ Pose.from_translation([3e-4, 4e-4, 0.0])),
        motion_s=5.0,
        thinking_s=1.0,
        touches=1,
        presses=4,
        corrections=1,
        pushes=2,
        peak_force_n=10.0,
        peak_moment_nm=1.0,
        insertion_depth_m=depth_m,
    )
    truth = SimulationTruth(
        seed=5, pose_base_hole=PoseData.of(HOLE), pose_base_peg=PoseData.of(pose_base_peg), wrench_contact=(0.0,) * 6
    )
    return result, truth


def _figures(depth_m: float = 0.016) -> TrialFigures:
    result, truth = _result(depth_m)
    return score(Workcell(), result, truth, wall_s=7.0, recording=None)


def test_a_trial_is_scored_against_the_truth() -> None:
    figures = _figures()
    assert figures.inserted and figures.seed == 5
    assert figures.duration_s == pytest.approx(6.0)
    assert figures.vision_error_mm == pytest.approx(0.5)
    assert figures.final_error_mm == pytest.approx(0.0, abs=1e-9)
    assert figures.insertion_depth_mm == pytest.approx(16.0)


def test_what_only_believes_to_be_in_is_not() -> None:
    figures = _figures(0.010)
    assert not figures.inserted
    assert figures.failure == "not_deep_enough"


def test_what_slid_past_the_plate_is_not_in_the_hole() -> None:
    result, truth = _result(0.030)
    beside = truth.pose_base_peg.pose() @ Pose.from_translation([0.1, 0.0, 0.0])
    truth = truth.model_copy(update={"pose_base_peg": PoseData.of(beside)})
    figures = score(Workcell(), result, truth, wall_s=7.0, recording=None)
    assert not figures.inserted
    assert figures.failure == "beside_the_hole"


def test_without_a_truth_nothing_is_scored_against_it() -> None:
    result, _ = _result(0.016)
    figures = score(Workcell(), result, None, wall_s=7.0, recording=None)
    assert figures.inserted and figures.seed is None and figures.final_error_mm is None


def test_wilson_interval_known_answers() -> None:
    """Wilson 1927; the values for 50 of 50 and 8 of 10 as in Newcombe 1998's method 3."""
    low, high = wilson95(50, 50)
    assert low == pytest.approx(0.92865, abs=1e-4) and high == pytest.approx(1.0)
    low, high = wilson95(8, 10)
    assert low == pytest.approx(0.4902, abs=1e-4) and high == pytest.approx(0.9433, abs=1e-4)


def test_a_bench_counts_failures_by_name() -> None:
    good, bad = _figures(), _figures(0.010)
    result = summarise("fused", 1000, [good, good, bad])
    assert (result.inserted, result.trials) == (2, 3)
    assert result.failures == {"not_deep_enough": 1}
    assert result.figures["peak_force_n"].p50 == pytest.approx(10.0)
    assert result.figures["peak_force_n"].count == 3
    depth = result.figures["insertion_depth_mm"]
    assert depth.count == 2 and depth.p50 == pytest.approx(16.0)
    with pytest.raises(ValueError, match="no trials"):
        summarise("fused", 1000, [])


@given(st.integers(0, 2**32 - 1))
def test_training_contacts_start_short_of_the_rim_with_the_error_they_say(seed: int) -> None:
    peg = Workcell().peg.shape()
    angles, lateral = draw_pose_peg_hole(np.random.default_rng(seed), 0.1, 0.002)
    pose = start_pose_hole_peg(angles, lateral, peg.tip_m)
    tip = pose.apply([0.0, 0.0, peg.tip_m])
    assert tip[2] == pytest.approx(-0.004)
    axis = pose.rotation[:, 2]
    at_face = tip - axis * tip[2] / axis[2]
    assert np.allclose(at_face[:2], lateral, atol=1e-12)
