"""A service works if its working threads do: one that died or hangs is named, one that waits for others is not."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.errors import CommandTimeout
from crosspih_common.keys import EVENTS, LOCATE, STOP
from crosspih_common.messages import Event, HoleEstimate, LocateHole, Severity, StopAccepted, StopMotion
from crosspih_common.service.works import Works

DEADLINE_S = 10.0


def wait_until(condition: Callable[[], bool], what: str) -> None:
    until = time.monotonic() + DEADLINE_S
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < until, f"never: {what}"
        pause.wait(0.01)


@pytest.fixture
def hub() -> MemoryHub:
    return MemoryHub()


@pytest.fixture
def vision(hub: MemoryHub) -> Iterator[Bus]:
    with Bus(hub.transport(), "c", "vision") as bus:
        yield bus


@pytest.fixture
def planning(hub: MemoryHub) -> Iterator[Bus]:
    with Bus(hub.transport(), "c", "planning") as bus:
        yield bus


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_lane_that_died_is_named(vision: Bus, planning: Bus) -> None:
    def dies(request: LocateHole) -> HoleEstimate:
        raise SystemExit  # no Exception: it ends the thread

    vision.serve(LOCATE, dies)
    works = Works(vision.duties)
    assert works.trouble() == ""
    with pytest.raises(CommandTimeout):
        planning.call(LOCATE, LocateHole(), 0.1)
    wait_until(lambda: works.trouble() == "vision:work has died", "the lane is missed")


def test_a_lane_that_hangs_is_named_until_it_goes_on(vision: Bus, planning: Bus) -> None:
    gate = threading.Event()

    def hangs(request: StopMotion) -> StopAccepted:
        gate.wait(DEADLINE_S)
        return StopAccepted(was_moving=False)

    vision.serve(STOP, hangs, longest_s=0.05)
    works = Works(vision.duties)
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(planning.call, STOP, StopMotion(), DEADLINE_S)
        wait_until(lambda: "vision:work hangs" in works.trouble(), "it is named")
        gate.set()
        answer.result(DEADLINE_S)
    wait_until(lambda: works.trouble() == "", "it works again")


def test_who_waits_for_another_does_not_hang(hub: MemoryHub, vision: Bus, planning: Bus) -> None:
    asked, gate = threading.Event(), threading.Event()
    hardware = Bus(hub.transport(), "c", "hardware")

    def slow(request: StopMotion) -> StopAccepted:
        asked.set()
        gate.wait(DEADLINE_S)
        return StopAccepted(was_moving=True)

    def asks_in_turn(request: LocateHole) -> HoleEstimate:
        vision.call(STOP, StopMotion(), DEADLINE_S)
        raise ZeroDivisionError

    hardware.serve(STOP, slow)
    vision.serve(LOCATE, asks_in_turn, longest_s=0.01)
    with hardware, ThreadPoolExecutor(1) as pool:
        answer = pool.submit(planning.call, LOCATE, LocateHole(), DEADLINE_S)
        assert asked.wait(DEADLINE_S)
        later = time.monotonic() + 0.5 * DEADLINE_S
        assert [duty.trouble(later) for duty in vision.duties()] == [""]
        gate.set()
        assert "ZeroDivisionError" in str(answer.exception(DEADLINE_S))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_subscription_whose_thread_died_is_named(vision: Bus, planning: Bus) -> None:
    def dies(event: Event) -> None:
        raise SystemExit

    planning.subscribe(EVENTS, dies)
    works = Works(planning.duties)
    works.watch("the writer", lambda: True)
    assert works.trouble() == ""
    vision.publisher(EVENTS).publish(Event(service="vision", severity=Severity.INFO, code="a", text="b"))
    wait_until(lambda: works.trouble() == f"planning:{EVENTS.path} has died", "the thread is missed")
    works.watch("the reader", lambda: False)
    assert works.trouble().endswith("; the reader has died")
