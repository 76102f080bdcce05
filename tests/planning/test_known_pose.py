"""The paper's second half: the cross tells where the hole is, another peg goes in there unseen and untouched."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from crosspih_common.config import PegDrawing
from crosspih_common.messages import AssemblyResult, Failure, Phase, PosePrior, SimulationTruth, Strategy
from services.operator.scoring.score import score
from tests.planning.cell_in_memory import CellInMemory

SEED = 5


@pytest.fixture(scope="module")
def cross(tmp_path_factory: pytest.TempPathFactory) -> tuple[AssemblyResult, SimulationTruth]:
    """The cross, assembled."""
    cell = CellInMemory(tmp_path_factory.mktemp("cross"))
    try:
        cell.reset(SEED)
        return cell.assemble(), cell.truth()
    finally:
        cell.close()


@pytest.fixture(scope="module")
def star(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CellInMemory]:
    """A cell with a star, in which vision refuses."""
    cell = CellInMemory(tmp_path_factory.mktemp("star"), peg=PegDrawing(outline="star"))
    cell.vision_scale = None
    yield cell
    cell.close()


def test_the_other_peg_goes_in_at_the_known_pose(
    cross: tuple[AssemblyResult, SimulationTruth], star: CellInMemory
) -> None:
    found, truth = cross
    assert found.inserted and found.pose_base_hole is not None and found.covariance is not None
    assert star.reset(SEED).pose_base_hole == truth.pose_base_hole
    known = PosePrior(pose_base_hole=found.pose_base_hole, covariance=found.covariance)
    result = star.assemble(Strategy.KNOWN_POSE, known)
    assert result.inserted
    assert (result.touches, result.presses, result.corrections) == (0, 0, 0)
    assert not {phase.phase for phase in star.phases} & {Phase.LOCATING, Phase.TOUCHING, Phase.CORRECTING}
    figures = score(star.cell.workcell, result, star.truth(), wall_s=0.0, recording=None)
    assert figures.inserted
    assert figures.final_error_mm is not None and figures.final_error_mm < 0.1


def test_a_request_that_tells_no_pose_is_refused(star: CellInMemory) -> None:
    star.reset(SEED)
    result = star.assemble(Strategy.KNOWN_POSE)
    assert (result.inserted, result.failure) == (False, Failure.REFUSED)
    assert "tells no pose" in result.failure_detail
