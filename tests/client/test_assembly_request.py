"""An assembly whose answer is lost: what the planner, or its successor, says on the bus is the result."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.bus.transport import Query
from crosspih_common.client import assembly_request
from crosspih_common.client.assembly_request import ask_assembly
from crosspih_common.errors import STOPPING, CommandRefused, NoService, NotSent
from crosspih_common.keys import ASSEMBLE, EVENTS, REFUSAL, STATUS, WITHDRAW
from crosspih_common.messages import (
    Assemble,
    AssemblyResult,
    CommandRefusal,
    Event,
    Failure,
    ServiceState,
    ServiceStatus,
    Severity,
    Strategy,
    Withdraw,
    WithdrawResult,
)

DEADLINE_S = 10.0
REQUEST = Assemble(strategy=Strategy.FUSED, assembly_id="a")


class Scene:
    """A planner that ends without a word when it is asked, and then does what a test says."""

    def __init__(self) -> None:
        self.hub = MemoryHub()
        self.planning = Bus(self.hub.transport(), "c", "planning")
        self.operator = Bus(self.hub.transport(), "c", "operator")
        self.then: Callable[[], None] = lambda: None
        self.hub.servers[ASSEMBLE.key("c")] = self._vanish
        self._threads: list[threading.Thread] = []

    def _vanish(self, query: Query) -> None:
        self._threads.append(threading.Thread(target=self.then))
        self._threads[-1].start()
        raise NoService("planning/assemble: nobody answers")

    def status(self, pid: int, uptime_s: float, state: ServiceState = ServiceState.READY) -> None:
        self.planning.publisher(STATUS).publish(
            ServiceStatus(service="planning", state=state, pid=pid, uptime_s=uptime_s)
        )

    def event(self, code: str) -> None:
        event = Event(service="planning", severity=Severity.WARNING, code=code, text=f"{code} at 12 mm")
        self.planning.publisher(EVENTS).publish(event)

    def close(self) -> None:
        for thread in self._threads:
            thread.join(DEADLINE_S)
        self.planning.close()
        self.operator.close()


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    monkeypatch.setattr(assembly_request, "LATE_S", 0.3)
    monkeypatch.setattr(assembly_request, "BACK_S", 5.0)
    monkeypatch.setattr(assembly_request, "FOUND_S", 5.0)
    monkeypatch.setattr(assembly_request, "YOUNGER_S", 0.0)
    scene = Scene()
    yield scene
    scene.close()


def result(assembly_id: str) -> AssemblyResult:
    return AssemblyResult(
        assembly_id=assembly_id, strategy=Strategy.FUSED, inserted=False, failure=Failure.ARM_STOPPED, backed_off=True,
        pose_base_hole=None, pose_base_peg=None, vision_pose_base_hole=None, motion_s=1.0, thinking_s=1.0, touches=0,
        presses=0, corrections=0, pushes=0, peak_force_n=0.0, peak_moment_nm=0.0, insertion_depth_m=0.0,
    )  # fmt: skip


def test_a_planner_that_lives_repeats_its_answer(scene: Scene) -> None:
    scene.planning.publisher(ASSEMBLE.reply_echo).publish(result("a"))  # of an assembly of before, by the same name

    def answers() -> None:
        scene.status(1, 1e4, ServiceState.ACTIVE)
        scene.planning.publisher(ASSEMBLE.reply_echo).publish(result("another"))
        scene.planning.publisher(ASSEMBLE.reply_echo).publish(result("a"))

    scene.then = answers
    found = ask_assembly(scene.operator, REQUEST, DEADLINE_S)
    assert (found.assembly_id, found.failure, found.backed_off, found.seq) == ("a", Failure.ARM_STOPPED, True, 2)


def test_a_refusal_is_still_one(scene: Scene) -> None:
    refusal = CommandRefusal(command=ASSEMBLE.path, refused="cell_unfit", text="two cells tick")

    def refuses() -> None:
        scene.planning.publisher(REFUSAL).publish(refusal)

    scene.then = refuses
    with pytest.raises(CommandRefused, match="two cells tick"):
        ask_assembly(scene.operator, REQUEST, DEADLINE_S)


@pytest.mark.parametrize("withdrawn", [True, False])
def test_a_successor_that_found_the_peg_is_asked_to_take_it_out(scene: Scene, withdrawn: bool) -> None:
    def take_out(request: Withdraw) -> WithdrawResult:
        return WithdrawResult(
            withdrawn=withdrawn, failure=None if withdrawn else Failure.STUCK, failure_detail="", distance_m=0.03,
            pose_base_peg=None, motion_s=1.0, peak_force_n=1.0, peak_moment_nm=0.1,
        )  # fmt: skip

    scene.planning.serve(WITHDRAW, take_out)
    scene.event("peg_found")  # of an earlier death: nothing of this one

    def comes_back() -> None:
        scene.status(2, 0.0)
        scene.event("peg_found")

    scene.then = comes_back
    said: list[str] = []
    found = ask_assembly(scene.operator, REQUEST, DEADLINE_S, said.append)
    assert found.failure is Failure.SERVICE_LOST and found.backed_off is withdrawn
    assert "planning ended in the middle of the assembly" in found.failure_detail
    assert ("30 mm" if withdrawn else "stuck") in found.failure_detail
    assert any("successor takes the peg out" in text for text in said)


def test_a_planner_that_was_stopped_in_order_has_a_successor_too(scene: Scene) -> None:
    def stopped(query: Query) -> None:
        scene.planning.publisher(REFUSAL).publish(
            CommandRefusal(command=ASSEMBLE.path, refused=STOPPING, text="planning was stopped")
        )
        scene.status(2, 0.0)
        scene.event("arm_found")
        raise CommandRefused(STOPPING, "planning was stopped")

    scene.hub.servers[ASSEMBLE.key("c")] = stopped
    found = ask_assembly(scene.operator, REQUEST, DEADLINE_S)
    assert found.failure is Failure.SERVICE_LOST and found.backed_off and "was stopped" in found.failure_detail


def test_a_peg_that_stands_clear_needs_no_withdrawal(scene: Scene) -> None:
    def comes_back() -> None:
        scene.status(2, 0.0)
        scene.event("arm_found")

    scene.then = comes_back
    assert ask_assembly(scene.operator, REQUEST, DEADLINE_S).backed_off


def test_an_answer_that_was_lost_on_the_way_and_a_planner_that_stays_away_are_named(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene.then = lambda: scene.status(1, 1e4)
    lost = ask_assembly(scene.operator, REQUEST, DEADLINE_S)
    assert lost.failure is Failure.SERVICE_LOST and "lost on the way" in lost.failure_detail and not lost.backed_off
    monkeypatch.setattr(assembly_request, "BACK_S", 0.3)
    scene.then = lambda: None
    # the status of before says nothing of now
    away = ask_assembly(scene.operator, REQUEST, DEADLINE_S)
    assert away.failure is Failure.SERVICE_LOST and "not back after" in away.failure_detail


def test_who_was_never_there_was_never_asked(scene: Scene) -> None:
    del scene.hub.servers[ASSEMBLE.key("c")]
    with pytest.raises(NotSent):
        ask_assembly(scene.operator, REQUEST, 0.1)
