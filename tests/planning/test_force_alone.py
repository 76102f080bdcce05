"""Assemblies that feel for the hole, and pushes that stall: real cell, real estimator, no vision."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.geometry import Pose
from crosspih_common.messages import BoreContact, Failure, PoseData, PosePrior, Strategy, floats
from services.operator.scoring.score import insertion_depth_m, pose_error
from services.planning.asking import BusPorts
from services.planning.calibrating import use_calibration
from services.planning.config import PlanningConfig
from services.planning.leaving import withdraw
from services.planning.run import Run
from services.planning.strategies.advised_push import push_in
from tests.planning.cell_in_memory import CellInMemory


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cell")


@pytest.fixture(scope="module")
def cell(folder: Path) -> Iterator[CellInMemory]:
    opened = CellInMemory(folder)
    opened.vision_scale = None
    yield opened
    opened.close()


def test_the_tip_meets_the_face_and_then_finds_the_hole(cell: CellInMemory) -> None:
    """Seed 2 is 11 mm off: no push straight ahead can enter."""
    cell.reset(2)
    result = cell.assemble(Strategy.FORCE_ALONE)
    assert result.inserted and result.pose_base_hole is not None
    assert result.vision_pose_base_hole is None and result.vision_refused == "" and not result.felt_for
    assert "the face" in {phase.text for phase in cell.phases}
    truth = cell.truth()
    error = pose_error(result.pose_base_hole.pose(), truth.pose_base_hole.pose())
    assert error.lateral_mm < 0.1 and error.rotation_deg < 0.3
    depth_m = insertion_depth_m(cell.cell.workcell, truth.pose_base_peg.pose(), truth.pose_base_hole.pose())
    assert depth_m > cell.cell.workcell.insertion_depth_m
    assert result.peak_force_n < 40.0 and result.peak_moment_nm < 4.0


def test_what_vision_refuses_to_see_is_felt_for(cell: CellInMemory) -> None:
    cell.reset(12)
    result = cell.assemble(Strategy.FUSED)
    assert result.inserted and result.touches > 0
    assert result.vision_refused.startswith("no_cross: ") and result.felt_for


def test_or_ends_with_a_name_where_feeling_is_forbidden(folder: Path) -> None:
    cell = CellInMemory(folder, planning=PlanningConfig(service_patience_s=0.5, feel_when_unseen=False))
    try:
        cell.reset(6)
        cell.vision_scale = None
        result = cell.assemble()
        assert result.failure is Failure.NOT_SEEN and result.backed_off
        assert "no_cross" in result.failure_detail
        assert result.vision_refused.startswith("no_cross: ") and not result.felt_for
    finally:
        cell.close()


def test_a_peg_that_stalls_in_its_bore_is_freed(cell: CellInMemory) -> None:
    """Pushed in 0.08 rad askew and stopped with its body in the bore: it takes advice to go on."""
    config = PlanningConfig(service_patience_s=0.5, push_timeout_s=5.0)
    workcell = cell.cell.workcell
    truth = cell.reset(3)
    with cell.planning.holding("a test") as lease:
        run = Run(workcell, config, BusPorts(cell.planning, config, lease), "stall")
        run.motion.dwell(0.05)
        use_calibration(run)
        askew = truth.pose_base_hole.pose() @ Pose.from_rotvec([0.08, 0.0, 0.0], [3e-4, -2e-4, 0.0])
        run.motion.approach(askew)
        cell.phases.clear()
        sd = np.array([3e-4, 3e-4, 3e-4, 0.05, 0.05, 0.02])
        belief = push_in(run, PosePrior(pose_base_hole=PoseData.of(askew), covariance=floats(np.diag(sd**2))))
        withdraw(run, truth.pose_base_hole.pose(), config.approach_m)
    told = [phase.text for phase in cell.phases]
    assert any("did not enter" in text for text in told)
    inside = tuple(contact.value for contact in BoreContact if contact is not BoreContact.OUTSIDE)
    assert any(text.startswith(inside) for text in told), told
    assert belief is not None and run.counts.pushes > 1
    error = pose_error(belief.pose_base_hole.pose(), truth.pose_base_hole.pose())
    assert error.rotation_deg < 2.5
