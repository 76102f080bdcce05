"""The lease over real processes: who holds the arm, who is refused, and what a stopped or killed holder leads to."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.errors import CommandRefused
from crosspih_common.holding import hold_arm
from crosspih_common.holding.beating import runs
from crosspih_common.keys import DWELL, LEASE, STOP
from crosspih_common.messages import Dwell, LeaseState, MotionOutcome, StopMotion, StopReason
from tests.conftest import ROOT, ServiceProcess

CELL = "cell1"
DEADLINE_S = 60.0
TIMEOUT_S = 1.0


class HolderProcess:
    """tests.holding.holder_process as a process of its own."""

    def __init__(self, endpoint: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.holding.holder_process", endpoint, CELL, "planning"],
            cwd=ROOT, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )  # fmt: skip

    def says(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture
def bus(endpoint: str, spawn: Callable[..., ServiceProcess], tmp_path: Path) -> Iterator[Bus]:
    """An operator beside a cell in real time; its patience is long, for tests are run on machines that are busy."""
    cell_file = tmp_path / "cell.yaml"
    cell_file.write_text(f"cell:\n  name: {CELL}\nhardware:\n  limits:\n    holder_timeout_s: {TIMEOUT_S}\n")
    spawn("hardware", "--endpoint", endpoint, "--cell", str(cell_file))
    with Bus(open_zenoh(endpoint), CELL, "operator") as bus:
        assert bus.latest(LEASE).wait_for(lambda _: True, DEADLINE_S) is not None
        yield bus


@pytest.fixture
def holder(bus: Bus) -> Iterator[HolderProcess]:
    """Another process that holds the arm and has it dwell: the arm was asked when this begins."""
    assert bus.endpoint is not None
    asked = bus.latest(DWELL.request_echo)
    started = HolderProcess(bus.endpoint)
    try:
        assert started.says() == "held"
        # "held" is said before the first dwell: a holder stopped in between leaves no motion to break off
        assert asked.wait_for(lambda _: True, DEADLINE_S) is not None
        yield started
    finally:
        started.end()


def test_a_stranger_is_refused_by_name_but_may_stop_the_arm(bus: Bus, holder: HolderProcess) -> None:
    with pytest.raises(CommandRefused, match=r"held by planning \(a test\)") as refused, hold_arm(bus, "another"):
        pass
    assert refused.value.code == "held"
    with pytest.raises(CommandRefused) as refused:
        bus.call(DWELL, Dwell(duration_s=0.1, lease="guessed"), DEADLINE_S)
    assert refused.value.code in ("no_lease", "busy")
    while not bus.call(STOP, StopMotion(), DEADLINE_S).was_moving:
        pass
    # a dwell or more may have come to its end before the stop
    said = holder.says()
    while said == StopReason.COMPLETED.value:
        said = holder.says()
    assert said == StopReason.STOPPED.value


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_holder_that_is_gone_loses_the_arm(bus: Bus, holder: HolderProcess, number: signal.Signals) -> None:
    states = bus.latest(LEASE)
    outcomes = bus.latest(DWELL.reply_echo)

    def of_the_holder(state: LeaseState) -> bool:
        return state.holder == "planning"

    def broken_off(outcome: MotionOutcome) -> bool:
        return outcome.stop_reason is StopReason.HOLDER_LOST

    assert states.wait_for(of_the_holder, DEADLINE_S) is not None
    holder.process.send_signal(number)
    lost = outcomes.wait_for(broken_off, DEADLINE_S)
    assert lost is not None and lost.duration_s < 9.0
    assert states.wait_for(lambda state: not state.holder, DEADLINE_S) is not None
    with hold_arm(bus, "after it") as lease:
        assert lease.ask(DWELL, Dwell(duration_s=0.05), DEADLINE_S).stop_reason is StopReason.COMPLETED
        if number is signal.SIGSTOP:
            # it comes back, and is told
            holder.process.send_signal(signal.SIGCONT)
            while (said := holder.says()) != "no_lease":
                assert said == StopReason.HOLDER_LOST.value


@pytest.fixture
def link(bus: Bus) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A link to the router that can be cut, and its endpoint."""
    assert bus.endpoint is not None
    host, _, port = bus.endpoint.removeprefix("tcp/").partition(":")
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.holding.stoppable_link", host, port], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    yield process, f"tcp/127.0.0.1:{process.stdout.readline().strip()}"
    process.kill()
    process.wait()
    process.stdout.close()


def test_a_holder_whose_link_is_cut_loses_the_arm(bus: Bus, link: tuple[subprocess.Popen[str], str]) -> None:
    """The holder runs on, and so do its beats: nothing of them comes through."""
    process, endpoint = link
    states, asked, outcomes = bus.latest(LEASE), bus.latest(DWELL.request_echo), bus.latest(DWELL.reply_echo)
    holder = HolderProcess(endpoint)
    try:
        assert holder.says() == "held"
        assert asked.wait_for(lambda _: True, DEADLINE_S) is not None
        process.send_signal(signal.SIGSTOP)
        lost = outcomes.wait_for(lambda outcome: outcome.stop_reason is StopReason.HOLDER_LOST, DEADLINE_S)
        assert lost is not None and lost.duration_s < 9.0
        assert states.wait_for(lambda state: not state.holder, DEADLINE_S) is not None
    finally:
        holder.end()


def test_an_arm_that_let_go_can_be_held_anew(bus: Bus) -> None:
    with hold_arm(bus, "first") as lease:
        lease.take()  # by the same process, which gave up the first lease unsaid
        assert lease.ask(DWELL, Dwell(duration_s=0.05), DEADLINE_S).stop_reason is StopReason.COMPLETED


def test_which_processes_can_run() -> None:
    assert runs(os.getpid())
    sleeper = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        assert runs(sleeper.pid)
        sleeper.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, sleeper.pid, os.WSTOPPED)
        assert not runs(sleeper.pid)
    finally:
        sleeper.kill()
        os.waitid(os.P_PID, sleeper.pid, os.WEXITED | os.WNOWAIT)
        assert not runs(sleeper.pid)  # a zombie
        sleeper.communicate()
    assert not runs(sleeper.pid)


def test_the_beats_need_nothing_but_the_shared_code() -> None:
    """The process that beats must start fast and small: no torch, no scipy, no service."""
    code = (
        "import sys, crosspih_common.holding.beating;"
        "print([name for name in ('torch', 'pybullet', 'services') if name in sys.modules])"
    )
    told = subprocess.run([sys.executable, "-c", code], cwd=Path(ROOT), capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"
