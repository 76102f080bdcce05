"""The assembly from end to end in memory: real cell, real estimator, real force/torque service, played vision."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.keys import ABORT, EVENTS, PAUSE
from crosspih_common.messages import (
    AbortAssembly,
    AssemblyPhase,
    AssemblyResult,
    Event,
    Failure,
    PauseAssembly,
    Phase,
)
from services.hardware.control.config import LimitsConfig
from services.operator.scoring.score import insertion_depth_m, pose_error
from services.planning.config import PlanningConfig
from tests.planning.cell_in_memory import CellInMemory


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One calibration file for all tests: the first assembly makes it."""
    return tmp_path_factory.mktemp("cell")


@pytest.fixture(scope="module")
def shared(folder: Path) -> Iterator[CellInMemory]:
    cell = CellInMemory(folder, calibrated=False)
    yield cell
    cell.close()


@pytest.fixture
def cell(shared: CellInMemory) -> CellInMemory:
    shared.vision_scale = 1.0
    shared.on_phase = lambda phase: None
    return shared


def assert_backed_off(cell: CellInMemory, result: AssemblyResult) -> None:
    assert result.backed_off
    truth = cell.truth()
    tip = truth.pose_base_peg.pose().apply([0.0, 0.0, cell.cell.workcell.peg.shape().tip_m])
    assert truth.pose_base_hole.pose().inverse().apply(tip)[2] < -0.02
    assert np.linalg.norm(truth.wrench_contact) == 0.0


def test_the_first_assembly_calibrates_and_inserts(cell: CellInMemory) -> None:
    cell.reset(1)
    result = cell.assemble()
    assert result.inserted and result.failure is None
    assert Phase.CALIBRATING in {phase.phase for phase in cell.phases}
    truth = cell.truth()
    assert result.pose_base_hole is not None
    error = pose_error(result.pose_base_hole.pose(), truth.pose_base_hole.pose())
    assert error.lateral_mm < 0.15 and error.rotation_deg < 0.6
    depth = insertion_depth_m(cell.cell.workcell, truth.pose_base_peg.pose(), truth.pose_base_hole.pose())
    assert depth > cell.cell.workcell.insertion_depth_m
    assert result.peak_force_n < 60.0 and result.peak_moment_nm < 6.0


def test_the_second_assembly_does_not_calibrate_again(cell: CellInMemory) -> None:
    cell.reset(2)
    result = cell.assemble()
    assert result.inserted
    assert Phase.CALIBRATING not in {phase.phase for phase in cell.phases}


def assert_good_pose(cell: CellInMemory, result: AssemblyResult) -> None:
    assert result.inserted and result.pose_base_hole is not None
    error = pose_error(result.pose_base_hole.pose(), cell.truth().pose_base_hole.pose())
    assert error.lateral_mm < 0.1 and error.rotation_deg < 0.3


def test_a_patient_push_swallows_poor_vision(cell: CellInMemory) -> None:
    """Twenty times the default error: the peg, far askew, creeps in; then it is aligned and feels the walls."""
    cell.vision_scale = 20.0
    cell.reset(4)
    result = cell.assemble()
    assert_good_pose(cell, result)
    assert result.touches == 0 and result.peak_force_n < 40.0


def test_a_push_that_does_not_enter_is_mended_by_touching(folder: Path) -> None:
    """The same without patience or advice: touches, estimate, correction, and a push that needs no patience."""
    cell = CellInMemory(folder, planning=PlanningConfig(service_patience_s=0.5, push_timeout_s=5.0, max_advices=0))
    try:
        cell.vision_scale = 20.0
        cell.reset(5)
        result = cell.assemble()
        assert_good_pose(cell, result)
        assert result.touches > 0 and result.corrections > 0
    finally:
        cell.close()


@pytest.mark.parametrize("lost", ["inference", "force_torque"])
def test_a_service_lost_once_the_peg_is_in_leaves_it_in(folder: Path, lost: str) -> None:
    """It dies for good while the walls are pressed: what is known by then counts, and the result says so."""
    cell = CellInMemory(folder)
    try:
        cell.reset(6)

        def lose(phase: AssemblyPhase) -> None:
            if phase.phase is Phase.SEATED and phase.text.startswith("pressing against"):
                cell.on_phase = lambda later: None
                cell.lose(lost)

        cell.on_phase = lose
        result = cell.assemble()
        assert result.inserted and not result.backed_off
        assert [warning for warning in result.warnings if warning.startswith(f"{lost} was lost once the peg was in")]
        assert_good_pose(cell, result)
        truth = cell.truth()
        depth = insertion_depth_m(cell.cell.workcell, truth.pose_base_peg.pose(), truth.pose_base_hole.pose())
        assert depth > cell.cell.workcell.insertion_depth_m
        assert np.linalg.norm(truth.wrench_contact[:3]) < 5.0  # not left pressing against a wall
    finally:
        cell.close()


def test_a_cap_that_stops_the_pressing_leaves_the_peg_in(folder: Path) -> None:
    """Presses so hard that the arm's cap ends them: what the seat tells counts, and the peg is not taken out again."""
    planning = PlanningConfig(service_patience_s=0.5, press_force_n=23.0, press_creep_m_s=0.003, max_overloads=1)
    cell = CellInMemory(folder, planning=planning, limits=LimitsConfig(force_cap_n=30.0))
    try:
        cell.reset(6)
        result = cell.assemble()
        assert any("no more pressing: force_cap" in phase.text for phase in cell.phases)
        assert_good_pose(cell, result)
        truth = cell.truth()
        depth = insertion_depth_m(cell.cell.workcell, truth.pose_base_peg.pose(), truth.pose_base_hole.pose())
        assert depth > cell.cell.workcell.insertion_depth_m
    finally:
        cell.close()


def test_a_pause_holds_the_arm_and_an_abort_ends_it_with_the_peg_backed_off(cell: CellInMemory) -> None:
    """Paused before the approach, and gone on with; paused again in the bore, and ended while paused."""
    cell.reset(7)
    assert not cell.bus.call(PAUSE, PauseAssembly(), 5.0).was_running
    told: list[str] = []
    clocks: list[int] = []

    def pause(phase: AssemblyPhase) -> None:
        if phase.phase in (Phase.APPROACHING, Phase.SEATED) and len(told) in (0, 2):
            accepted = cell.bus.call(PAUSE, PauseAssembly(), 5.0)
            assert accepted.was_running and accepted.paused

    def answer(event: Event) -> None:
        if event.code not in ("paused", "resumed"):
            return
        told.append(event.code)
        clocks.append(cell.truth().stamp_ns)
        if told == ["paused"]:
            cell.bus.call(PAUSE, PauseAssembly(paused=False), 5.0)
        elif told == ["paused", "resumed", "paused"]:
            cell.bus.call(ABORT, AbortAssembly(), 5.0)

    cell.on_phase = pause
    cell.bus.subscribe(EVENTS, answer)
    result = cell.assemble()
    assert told == ["paused", "resumed", "paused"]
    assert clocks[0] == clocks[1]  # the cell stood still meanwhile
    assert result.failure is Failure.ABORTED
    assert_backed_off(cell, result)


def test_a_hole_out_of_reach_ends_with_a_name(cell: CellInMemory) -> None:
    cell.reset(8, offset_hole=(0.0, 0.0, 0.4, 0.0, 0.0, 0.0))
    result = cell.assemble()
    assert result.failure is Failure.UNREACHABLE
    assert_backed_off(cell, result)


def test_a_lost_service_ends_with_a_name(folder: Path) -> None:
    cell = CellInMemory(folder, with_inference=False)
    try:
        cell.reset(9)
        result = cell.assemble()
        assert result.failure is Failure.SERVICE_LOST
        assert "inference" in result.failure_detail
        assert_backed_off(cell, result)
    finally:
        cell.close()


WALL_TIMES = {"stamp_ns", "seq", "thinking_s"}


def test_the_same_seed_gives_the_same_trial_to_the_last_bit(folder: Path, cell: CellInMemory) -> None:
    cell.reset(10)
    first = cell.assemble()
    again = CellInMemory(folder)
    try:
        again.reset(10)
        second = again.assemble()
        assert first.model_dump_json(exclude=WALL_TIMES) == second.model_dump_json(exclude=WALL_TIMES)
        assert first.inserted
        third_truth = again.reset(10)
        assert third_truth.pose_base_hole == cell.truth().pose_base_hole
    finally:
        again.close()
