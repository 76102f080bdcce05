"""What goes wrong beside the peg: defects, refusals, a cell that is not fit, an arm that is held; and withdrawal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from crosspih_common.bus import Bus
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.holding import hold_arm
from crosspih_common.keys import CLOCK, LEASE, MOVE_LINEAR, WITHDRAW, WRENCH_RAW
from crosspih_common.messages import (
    AssemblyResult,
    CellClock,
    Failure,
    MoveLinear,
    Phase,
    PoseData,
    PosePrior,
    Strategy,
    Withdraw,
)
from services.operator.scoring.score import insertion_depth_m
from services.planning.moving import PegMotion
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies import STRATEGIES
from tests.planning.cell_in_memory import CellInMemory


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CellInMemory]:
    cell = CellInMemory(tmp_path_factory.mktemp("cell"))
    yield cell
    cell.close()


@pytest.fixture
def cell(shared: CellInMemory) -> CellInMemory:
    shared.vision_scale = 1.0
    shared.on_phase = lambda phase: None
    return shared


def tip_depth_m(cell: CellInMemory) -> float:
    """How far the tip truly is behind the hole's face."""
    truth = cell.truth()
    tip = truth.pose_base_peg.pose().apply([0.0, 0.0, cell.cell.workcell.peg.shape().tip_m])
    return float(truth.pose_base_hole.pose().inverse().apply(tip)[2])


def seated(cell: CellInMemory) -> bool:
    """Whether the peg truly is in."""
    truth = cell.truth()
    depth_m = insertion_depth_m(cell.cell.workcell, truth.pose_base_peg.pose(), truth.pose_base_hole.pose())
    return depth_m > cell.cell.workcell.insertion_depth_m


def test_a_defect_in_a_strategy_ends_with_the_peg_out_and_a_name(
    cell: CellInMemory, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    fused = STRATEGIES[Strategy.FUSED]

    def broken(run: Run) -> PosePrior:
        fused(run)
        raise ValueError("planted: the peg is in, and this is wrong")

    monkeypatch.setitem(STRATEGIES, Strategy.FUSED, broken)
    cell.reset(21)
    result = cell.assemble()
    assert result.failure is Failure.DEFECT and "ValueError: planted" in result.failure_detail
    assert result.backed_off and tip_depth_m(cell) < -0.02
    assert cell.phases[-1].phase is Phase.DONE
    assert "in broken" in capfd.readouterr().err  # the trace


def test_a_refused_return_from_a_wall_leaves_the_peg_in(cell: CellInMemory, monkeypatch: pytest.MonkeyPatch) -> None:
    slide_to, fused = PegMotion.slide_to, STRATEGIES[Strategy.FUSED]
    runs: list[Run] = []

    def remembered(run: Run) -> PosePrior:
        runs.append(run)
        return fused(run)

    def refused(motion: PegMotion, pose_base_peg: Pose, speed_m_s: float = 0.03) -> None:
        if runs and len(runs[0].presses) == 2:
            raise AssemblyFailed(Failure.UNREACHABLE, "joint_limit: planted")
        slide_to(motion, pose_base_peg, speed_m_s)

    monkeypatch.setitem(STRATEGIES, Strategy.FUSED, remembered)
    monkeypatch.setattr(PegMotion, "slide_to", refused)
    cell.reset(22)
    result = cell.assemble()
    assert result.inserted and result.presses == 2 and seated(cell)
    assert any("no more pressing: joint_limit" in phase.text for phase in cell.phases)
    assert result.pose_base_hole is not None


def joints(cell: CellInMemory) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Where the peg truly is."""
    return cell.truth().pose_base_peg.pose().matrix()


def assert_refused_unmoved(cell: CellInMemory, text: str) -> None:
    before = joints(cell)
    with pytest.raises(CommandRefused, match=text) as refused:
        cell.assemble()
    assert refused.value.code == "cell_unfit"
    assert np.abs(joints(cell) - before).max() < 1e-4


def test_a_second_cell_on_the_same_keys_is_named_before_anything_moves(cell: CellInMemory) -> None:
    cell.reset(23)
    ticks = cell.bus.latest(CLOCK)
    own = ticks.value()
    assert own is not None
    # another cell's clock, between two ticks of this one
    with Bus(cell.hub.transport(), cell.cell.workcell.name, "hardware") as double:
        double.publisher(CLOCK).publish(CellClock(stamp_ns=own.stamp_ns, boot_id="double", realtime=False))
        cell.reset(23)
        assert_refused_unmoved(cell, "two cells tick on the keys of cell1")


def test_a_sensor_that_stands_still_is_named_before_anything_moves(
    cell: CellInMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    put, key = cell.hub.put, WRENCH_RAW.key(cell.cell.workcell.name)

    def cut(at: str, *sample: Any) -> None:
        if at != key:
            put(at, *sample)

    cell.planning.clock = cell.planning.bus.latest(CLOCK, 256)
    cell.reset(24)
    monkeypatch.setattr(cell.hub, "put", cut)
    assert_refused_unmoved(cell, r"sensor \(ft/raw\) said nothing")


def test_who_holds_the_arm_is_named_to_whoever_comes_next(cell: CellInMemory) -> None:
    cell.reset(25)
    holder = cell.bus.latest(LEASE)
    with hold_arm(cell.bus, "a look"), pytest.raises(CommandRefused, match=r"held: .* operator \(a look\)"):
        cell.assemble()
    told = holder.wait_for(lambda state: not state.holder, 5.0)
    assert told is not None
    assert cell.assemble().inserted


def withdrawn(cell: CellInMemory, result: AssemblyResult, **wanted: float) -> None:
    assert result.inserted and seated(cell)
    out = cell.bus.call(WITHDRAW, Withdraw(**wanted), 60.0)
    assert out.withdrawn and out.failure is None
    assert -0.033 < tip_depth_m(cell) < -0.027
    assert out.peak_force_n < 20.0 and out.distance_m > 0.05


def test_a_seated_peg_is_withdrawn_and_goes_in_again(cell: CellInMemory) -> None:
    cell.reset(26)
    withdrawn(cell, cell.assemble())
    # the same hole once more, from where the peg was left
    withdrawn(cell, cell.assemble())
    # nothing is left to be withdrawn
    assert cell.bus.call(WITHDRAW, Withdraw(), 60.0).distance_m < 1e-3


def test_a_peg_that_presses_against_its_bore_is_withdrawn(cell: CellInMemory) -> None:
    """As a planner that is killed while it presses leaves it: no payload can be checked at rest then."""
    cell.reset(28)
    assert cell.assemble().inserted
    pressed = cell.truth().pose_base_peg.pose() @ Pose.from_translation([6e-4, 0.0, 0.0])
    with hold_arm(cell.bus, "a push") as lease:
        lease.ask(MOVE_LINEAR, MoveLinear(pose_base_peg=PoseData.of(pressed), speed_m_s=0.002), 30.0)
    out = cell.bus.call(WITHDRAW, Withdraw(), 60.0)
    assert any("presses against its bore" in phase.text for phase in cell.phases)
    assert out.withdrawn and -0.033 < tip_depth_m(cell) < -0.027


def test_a_hole_that_the_peg_cannot_be_in_is_refused_by_the_fields_name(cell: CellInMemory) -> None:
    """Found by `crosspih bench fuzz`: eleven metres of a guarded move were a defect of ours."""
    cell.reset(29)
    far = cell.truth().pose_base_hole.pose() @ Pose.from_translation([0.0, 0.0, -11.0])
    out = cell.bus.call(WITHDRAW, Withdraw(pose_base_hole=PoseData.of(far)), 60.0)
    assert not out.withdrawn and out.failure is Failure.REFUSED
    assert out.failure_detail.startswith("pose_base_hole: by it the tip is 1")
    assert out.distance_m == 0.0


def test_a_peg_that_resists_is_left_where_it_is(cell: CellInMemory) -> None:
    cell.reset(27)
    assert cell.assemble().inserted
    out = cell.bus.call(WITHDRAW, Withdraw(force_limit_n=0.3), 60.0)
    assert not out.withdrawn and out.failure is Failure.STUCK and "contact after" in out.failure_detail
    assert tip_depth_m(cell) > 0.02
