"""What the buttons ask: nothing while somebody else holds the arm, and refusals in words."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from crosspih_common.bus import Bus
from crosspih_common.bus.memory import MemoryHub
from crosspih_common.errors import CommandRefused
from crosspih_common.keys import ABORT, ASSEMBLE, PAUSE, RECORD_START, RECORD_STOP
from crosspih_common.messages import (
    AbortAccepted,
    AbortAssembly,
    Assemble,
    AssemblyResult,
    LeaseState,
    PauseAccepted,
    PauseAssembly,
    RecordingStatus,
    StartRecording,
    StopRecording,
    Strategy,
)
from services.viewer.asking import PageAnswer, PageCommands
from tests.viewer.test_timeline import result


class Planner:
    """The other end: counts what it is asked."""

    def __init__(self, hub: MemoryHub) -> None:
        self.planning, self.recorder = (Bus(hub.transport(), "cell1", name) for name in ("planning", "recorder"))
        self.hub = hub
        self.asked: list[str] = []
        self.go_on = threading.Event()
        self.go_on.set()
        self.refuse = False
        self.planning.serve(ASSEMBLE, self._assemble, refuse_when_busy=True)
        self.planning.serve(ABORT, self._abort, lane="now")
        self.planning.serve(PAUSE, self._pause, lane="now")
        self.recorder.serve(RECORD_START, self._start)
        self.recorder.serve(RECORD_STOP, self._stop)

    def _assemble(self, request: Assemble) -> AssemblyResult:
        self.asked.append(f"{request.assembly_id} {request.strategy.value}")
        assert self.go_on.wait(10.0)
        if self.refuse:
            raise CommandRefused("cell_unfit", "the arm stands too near to the floor")
        return result(1.0).model_copy(update={"stamp_ns": -1})

    def _abort(self, request: AbortAssembly) -> AbortAccepted:
        self.asked.append("abort")
        return AbortAccepted(was_running=not self.go_on.is_set())

    def _pause(self, request: PauseAssembly) -> PauseAccepted:
        return PauseAccepted(was_running=not self.go_on.is_set(), paused=request.paused)

    def _start(self, request: StartRecording) -> RecordingStatus:
        self.asked.append("record")
        return RecordingStatus(recording=True, path="r/a.mcap")

    def _stop(self, request: StopRecording) -> RecordingStatus:
        self.asked.append("end")
        return RecordingStatus(recording=False, path="r/a.mcap", warnings=("3 samples are missing",))


@pytest.fixture
def planner() -> Iterator[Planner]:
    hub = MemoryHub()
    found = Planner(hub)
    yield found
    found.go_on.set()
    found.planning.close()
    found.recorder.close()


@pytest.fixture
def lease() -> list[LeaseState]:
    return [LeaseState(since_ns=0)]


@pytest.fixture
def asking(planner: Planner, lease: list[LeaseState]) -> Iterator[PageCommands]:
    with Bus(planner.hub.transport(), "cell1", "viewer") as bus:
        yield PageCommands(bus, lambda: lease[-1] if lease else None, lambda: False)


def test_an_assembly_is_recorded_and_its_end_told(planner: Planner, asking: PageCommands) -> None:
    answer = asking.assemble(Strategy.SPIRAL, seed=None)
    assert planner.asked == ["record", "assembly-spiral spiral", "end"]
    assert answer.good and "25.0 mm deep" in answer.text and "r/a.mcap; 3 samples are missing" in answer.text


@pytest.mark.parametrize("ask", ["assemble", "withdraw", "reset"])
def test_nothing_is_asked_while_somebody_holds_the_arm(
    planner: Planner, asking: PageCommands, lease: list[LeaseState], ask: str
) -> None:
    lease.append(LeaseState(since_ns=0, holder="operator", purpose="hand-eye calibration"))
    asks: dict[str, Callable[[], PageAnswer]] = {
        "assemble": lambda: asking.assemble(Strategy.FUSED, 7), "withdraw": asking.withdraw,
        "reset": lambda: asking.reset(7),
    }  # fmt: skip
    answer = asks[ask]()
    assert not answer.good and "operator holds the arm for hand-eye calibration" in answer.text
    assert asking.busy == answer.text and planner.asked == []


def test_nothing_is_asked_before_it_is_known_who_holds_the_arm(
    planner: Planner, asking: PageCommands, lease: list[LeaseState]
) -> None:
    lease.clear()
    assert not asking.assemble(Strategy.FUSED, None).good and planner.asked == []


def test_one_thing_at_a_time_but_stop_and_pause_pass(planner: Planner, asking: PageCommands) -> None:
    planner.go_on.clear()
    answers = []
    running = threading.Thread(target=lambda: answers.append(asking.assemble(Strategy.FUSED, None)))
    running.start()
    try:
        until = threading.Event()
        while len(planner.asked) < 2:
            assert running.is_alive()
            until.wait(0.005)
        again = asking.assemble(Strategy.FUSED, None)
        assert not again.good and "still under way" in again.text
        assert asking.pause(True).text == "held before its next motion" and asking.pause(False).text == "going on"
        assert asking.stop().good
    finally:
        planner.go_on.set()
        running.join(10.0)
    assert answers[0].good and planner.asked.count("assembly-fused fused") == 1
    assert not asking.stop().good and not asking.pause(True).good


def test_a_refusal_is_told_in_words_and_the_recording_is_ended(planner: Planner, asking: PageCommands) -> None:
    planner.refuse = True
    answer = asking.assemble(Strategy.FUSED, None)
    assert not answer.good and answer.text == "refused (cell_unfit): the arm stands too near to the floor"
    assert planner.asked[-1] == "end"
