"""A planner that is started after one that ended in an assembly says where that one left the peg, and moves nothing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from crosspih_common.keys import EVENTS, LEASE, LEASE_TAKE, WITHDRAW
from crosspih_common.messages import LeaseState, Severity, TakeLease, Withdraw
from services.planning.config import PlanningConfig
from services.planning.predecessor import left_in_the_middle
from services.planning.shell import PlanningShell
from tests.planning.cell_in_memory import CellInMemory

DEADLINE_S = 30.0


@pytest.fixture
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CellInMemory]:
    cell = CellInMemory(tmp_path_factory.mktemp("cell"))
    yield cell
    cell.close()


@pytest.mark.parametrize(
    ("state", "purpose"),
    [
        (LeaseState(since_ns=0), ""),
        (LeaseState(since_ns=0, holder="planning", purpose="assembly a"), "assembly a"),
        (LeaseState(since_ns=0, lost_holder="planning", lost_purpose="assembly a"), "assembly a"),
        (LeaseState(since_ns=0, lost_holder="planning", lost_purpose="withdrawal"), ""),
        (LeaseState(since_ns=0, lost_holder="operator", lost_purpose="assembly a"), ""),
    ],
)
def test_only_a_planners_own_assembly_was_left(state: LeaseState, purpose: str) -> None:
    assert left_in_the_middle(state, "planning") == purpose


def test_the_peg_is_found_in_the_hole_and_comes_out_when_it_is_asked_for(cell: CellInMemory) -> None:
    cell.reset(3)
    assert cell.assemble().inserted
    # as a planner leaves it that ended in the middle: its lease was never given back, and no beat comes
    hardware = cell.bus.latest(LEASE, 16)
    cell.bus.call(LEASE_TAKE, TakeLease(holder="planning", purpose="assembly test"), DEADLINE_S)
    events = cell.bus.latest(EVENTS, 64)
    before = cell.truth().pose_base_peg.pose()
    cell.lose("planning")
    successor = PlanningShell(cell.context("planning"), PlanningConfig(service_patience_s=0.5))
    found = events.wait_for(lambda event: event.code == "peg_found" and event.severity is Severity.WARNING, DEADLINE_S)
    assert found is not None and "assembly test" in found.text and "past the hole's face" in found.text
    assert np.allclose(cell.truth().pose_base_peg.pose().translation_m, before.translation_m, atol=1e-4)
    assert hardware.wait_for(lambda state: state.lost_holder == "" and state.holder == "", DEADLINE_S) is not None
    assert cell.bus.call(WITHDRAW, Withdraw(), 120.0).withdrawn
    successor.close()


def test_what_is_asked_before_the_arm_has_let_go_of_the_planner_before_waits_for_it(cell: CellInMemory) -> None:
    cell.reset(3)
    assert cell.assemble().inserted
    cell.bus.call(LEASE_TAKE, TakeLease(holder="planning", purpose="calibration"), DEADLINE_S)
    cell.lose("planning")
    successor = PlanningShell(cell.context("planning"), PlanningConfig(service_patience_s=0.5))
    assert cell.bus.latest(LEASE).wait_for(lambda state: state.holder == "planning", DEADLINE_S) is not None
    assert cell.bus.call(WITHDRAW, Withdraw(), 120.0).withdrawn
    successor.close()
