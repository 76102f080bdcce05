"""kill -9 of one service after the other while an assembly runs: it comes back, and the assembly ends in order."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable

import numpy as np
import pytest

from crosspih_common.client.assembly_request import FOUND
from crosspih_common.errors import CommandRefused
from crosspih_common.holding import hold_arm
from crosspih_common.keys import DWELL, EVENTS, JOINT_STATE, PHASE
from crosspih_common.messages import AssemblyPhase, Dwell, Event, Failure, MotionOutcome, Phase, Severity, Strategy
from services.operator.assembly.session import Session
from tests.system.running_cell import DEADLINE_S, KillOnPhase, RunningCell, wait_until

SEED = 1000


def assert_inserts(session: Session, seed: int | None) -> None:
    figures, result = session.trial(seed, Strategy.FUSED, record=False)
    assert figures.inserted, (figures.failure, figures.failure_detail, result)


def looking(phase: AssemblyPhase) -> bool:
    return phase.phase is Phase.LOCATING


def pushing(phase: AssemblyPhase) -> bool:
    return phase.phase is Phase.PUSHING and phase.text.startswith("compliant push")


@pytest.mark.parametrize(("service", "when"), [("vision", looking), ("inference", pushing), ("force_torque", pushing)])
def test_an_assembly_outlives_a_service_that_only_computes(
    cell: RunningCell, session: Session, service: str, when: Callable[[AssemblyPhase], bool]
) -> None:
    restarts = cell.row(service).restarts
    kill = KillOnPhase(cell, service, when)
    session.bus.subscribe(PHASE, kill)
    figures, result = session.trial(SEED, Strategy.FUSED, record=False)
    assert kill.killed_pid is not None
    cell.wait_restarted(service, kill.killed_pid)
    assert cell.row(service).restarts == restarts + 1
    if not figures.inserted:
        assert result.failure is not None and result.failure_detail
        assert result.backed_off
    if service == "vision" or not figures.inserted:
        session.wait_for_services(DEADLINE_S)
        assert_inserts(session, SEED + 1)


def test_a_service_that_hangs_is_noticed_and_waited_for(cell: RunningCell, session: Session) -> None:
    """SIGSTOP while it thinks: its token goes, the planner says so, and goes on once it is back."""
    stopped: list[int] = []
    told: list[str] = []

    def stop_once(phase: AssemblyPhase) -> None:
        if phase.phase is Phase.LOCATING and not stopped:
            pid = cell.row("vision").pid
            assert pid is not None
            stopped.append(pid)
            os.kill(pid, signal.SIGSTOP)

    def go_on(event: Event) -> None:
        if stopped and event.code == "service_lost":
            told.append(event.text)
            os.kill(stopped[0], signal.SIGCONT)

    session.bus.subscribe(PHASE, stop_once)
    session.bus.subscribe(EVENTS, go_on)
    assert_inserts(session, SEED + 2)
    assert told and told[0].startswith("vision is gone in the middle of an assembly")


def test_hardware_that_is_lost_in_motion_ends_the_assembly_by_name(cell: RunningCell, session: Session) -> None:
    kill = KillOnPhase(cell, "hardware", pushing)
    session.bus.subscribe(PHASE, kill)
    figures, result = session.trial(SEED, Strategy.FUSED, record=False)
    assert kill.killed_pid is not None
    assert not figures.inserted
    assert result.failure is Failure.SERVICE_LOST
    assert "hardware" in result.failure_detail
    assert result.backed_off
    cell.wait_restarted("hardware", kill.killed_pid)
    session.wait_for_services(DEADLINE_S)
    assert_inserts(session, SEED + 1)


def test_planning_that_is_lost_is_named_and_its_successor_takes_the_peg_out(
    cell: RunningCell, session: Session
) -> None:
    kill = KillOnPhase(cell, "planning", pushing)
    session.bus.subscribe(PHASE, kill)
    found: list[Event] = []
    session.bus.subscribe(EVENTS, lambda event: found.append(event) if event.code in FOUND else None)
    figures, result = session.trial(SEED, Strategy.FUSED, record=False)
    assert kill.killed_pid is not None
    assert not figures.inserted and result.failure is Failure.SERVICE_LOST
    assert "planning ended in the middle of the assembly" in result.failure_detail
    assert result.backed_off, result.failure_detail
    # on a machine that is slow to kill, the arm may have left the hole by then
    told = [event.text for event in found if event.severity is Severity.WARNING]
    assert len(told) == 1 and "ended in its assembly assembly-fused" in told[0]

    at_rest: list[MotionOutcome] = []

    def idle() -> bool:
        try:
            with hold_arm(session.bus, "a look") as lease:
                at_rest.append(lease.ask(DWELL, Dwell(duration_s=0.2), 30.0))
        except CommandRefused as refusal:
            assert refusal.code in ("busy", "held")
            return False
        return True

    joints = session.bus.latest(JOINT_STATE)
    wait_until(idle, "the arm takes a new command")
    # a stream lags behind an answer: what it says of the end of the dwell, told every 4 ms
    state = joints.wait_for(lambda told: told.stamp_ns > at_rest[0].stamp_ns - 10_000_000, 5.0)
    assert state is not None
    assert np.abs(state.speeds_rad_s).max() < 0.01
    cell.wait_restarted("planning", kill.killed_pid)
    session.wait_for_services(DEADLINE_S)
    # from where the arm was left, and on the same hole: it goes home first
    assert_inserts(session, None)


def test_a_router_that_is_lost_costs_the_assembly_but_not_its_result(cell: RunningCell, session: Session) -> None:
    kill = KillOnPhase(cell, "router", pushing)
    session.bus.subscribe(PHASE, kill)
    said: list[str] = []
    session.bus.subscribe(PHASE, lambda phase: said.append(f"{phase.phase.value}: {phase.text}"))
    figures, result = session.trial(SEED, Strategy.FUSED, record=False)
    assert kill.killed_pid is not None
    assert result.inserted or result.failure in (Failure.ARM_STOPPED, Failure.SERVICE_LOST), result
    assert figures.inserted or result.backed_off, (result.failure_detail, said[-4:])
    cell.wait_restarted("router", kill.killed_pid)
    session.wait_for_services(DEADLINE_S)
    assert_inserts(session, SEED + 1)
