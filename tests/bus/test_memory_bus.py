"""The typed bus over the in-memory transport: what every transport must give."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

import pytest

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.bus.bus import NOW_LANE
from crosspih_common.bus.codec import label_with_seq
from crosspih_common.errors import CommandRefused, CommandTimeout, CrosspihError, NoService
from crosspih_common.keys import CLOCK, DWELL, EVENTS, JOINT_STATE, REFUSAL, STOP
from crosspih_common.messages import (
    CellClock,
    Dwell,
    Event,
    JointState,
    Severity,
    StopAccepted,
    StopMotion,
)

ZEROS = (0.0,) * 6


@pytest.fixture
def hub() -> MemoryHub:
    return MemoryHub()


@pytest.fixture
def hardware(hub: MemoryHub) -> Iterator[Bus]:
    with Bus(hub.transport(), "c", "hardware") as bus:
        yield bus


@pytest.fixture
def planning(hub: MemoryHub) -> Iterator[Bus]:
    with Bus(hub.transport(), "c", "planning") as bus:
        yield bus


def _collect(bus: Bus, count: int) -> tuple[list[JointState], threading.Event]:
    got: list[JointState] = []
    enough = threading.Event()

    def take(state: JointState) -> None:
        got.append(state)
        if len(got) == count:
            enough.set()

    bus.subscribe(JOINT_STATE, take)
    return got, enough


def test_every_sample_arrives_in_order_numbered_and_stamped(hardware: Bus, planning: Bus) -> None:
    got, enough = _collect(planning, 50)
    hardware.clock.observe(123, "boot")
    publisher = hardware.publisher(JOINT_STATE)
    for _ in range(50):
        publisher.publish(JointState(joints_rad=ZEROS, speeds_rad_s=ZEROS))
    assert enough.wait(5.0)
    assert [state.seq for state in got] == list(range(50))
    assert {state.stamp_ns for state in got} == {123}


def test_one_publisher_a_key_so_that_numbers_never_fork(hardware: Bus) -> None:
    assert hardware.publisher(JOINT_STATE) is hardware.publisher(JOINT_STATE)


def test_latest_keeps_the_newest(hardware: Bus, planning: Bus) -> None:
    latest = planning.latest(JOINT_STATE, depth=2)
    for stamp in range(5):
        hardware.publisher(JOINT_STATE).publish(JointState(stamp_ns=stamp, joints_rad=ZEROS, speeds_rad_s=ZEROS))
    assert [state.stamp_ns for state in latest.values()] == [3, 4]
    assert latest.wait_for(lambda state: state.stamp_ns == 4, 0.0) is not None
    assert latest.wait_for(lambda state: state.stamp_ns == 9, 0.01) is None


def test_late_readers_get_a_state_but_not_a_stream(hub: MemoryHub, hardware: Bus) -> None:
    hardware.publisher(EVENTS).publish(Event(service="hardware", severity=Severity.INFO, code="x", text="y"))
    hardware.publisher(JOINT_STATE).publish(JointState(joints_rad=ZEROS, speeds_rad_s=ZEROS))
    with Bus(hub.transport(), "c", "operator") as late:
        assert late.latest(EVENTS).wait_for(lambda _: True, 1.0) is not None
        assert late.latest(JOINT_STATE).value() is None


def test_a_wrong_type_is_counted_and_reported(hub: MemoryHub, planning: Bus) -> None:
    said: list[str] = []
    planning.on_reject = said.append
    latest = planning.latest(JOINT_STATE)
    key = JOINT_STATE.key("c")
    hub.put(key, b"{}", label_with_seq(Dwell, 0), keep=False)
    hub.put(key, b"not json", label_with_seq(JointState, 1), keep=False)
    assert latest.value() is None
    assert planning.traffic.total("rejected") == 2
    assert "crosspih.Dwell/1" in said[0] and "crosspih.JointState/1" in said[0]


def test_overflow_is_counted_never_silent(hardware: Bus, planning: Bus) -> None:
    gate, entered = threading.Event(), threading.Event()

    def slow(state: JointState) -> None:
        entered.set()
        gate.wait(5.0)

    planning.subscribe(JOINT_STATE, slow, capacity=4)
    publisher = hardware.publisher(JOINT_STATE)
    publisher.publish(JointState(joints_rad=ZEROS, speeds_rad_s=ZEROS))
    assert entered.wait(5.0)
    for _ in range(10):
        publisher.publish(JointState(joints_rad=ZEROS, speeds_rad_s=ZEROS))
    gate.set()
    assert planning.traffic.total("dropped") == 6


def test_a_command_is_answered_and_both_ends_are_echoed(hub: MemoryHub, hardware: Bus, planning: Bus) -> None:
    hardware.serve(STOP, lambda request: StopAccepted(was_moving=True))
    with Bus(hub.transport(), "c", "recorder") as recorder:
        asked, answered = recorder.latest(STOP.request_echo), recorder.latest(STOP.reply_echo)
        assert planning.call(STOP, StopMotion(), 1.0).was_moving
        assert asked.value() is not None and answered.value() is not None


def test_refusals_keep_code_and_reason(hardware: Bus, planning: Bus) -> None:
    def refuse(request: StopMotion) -> StopAccepted:
        raise CommandRefused("limit", "joint 3 is outside its range")

    hardware.serve(STOP, refuse)
    with pytest.raises(CommandRefused, match="limit: joint 3 is outside its range") as caught:
        planning.call(STOP, StopMotion(), 1.0)
    assert caught.value.code == "limit"


def test_a_defect_in_a_handler_reaches_the_asker(hardware: Bus, planning: Bus) -> None:
    said: list[str] = []
    hardware.on_reject = said.append

    def broken(request: StopMotion) -> StopAccepted:
        raise ZeroDivisionError("oops")

    hardware.serve(STOP, broken)
    with pytest.raises(CommandRefused, match="internal: ZeroDivisionError: oops"):
        planning.call(STOP, StopMotion(), 1.0)
    assert "oops" in said[0]


def test_nobody_there_and_too_slow_are_told_apart(hardware: Bus, planning: Bus) -> None:
    with pytest.raises(NoService):
        planning.call(STOP, StopMotion(), 0.1)
    gate = threading.Event()
    hardware.serve(STOP, lambda request: StopAccepted(was_moving=gate.wait(5.0)))
    with pytest.raises(CommandTimeout, match=r"0\.05 s"):
        planning.call(STOP, StopMotion(), 0.05)
    gate.set()


def _ask_and_ignore(bus: Bus) -> None:
    with contextlib.suppress(CrosspihError):
        bus.call(DWELL, Dwell(duration_s=1), 5.0)


def test_a_busy_arm_refuses_but_stop_passes(hub: MemoryHub, hardware: Bus, planning: Bus) -> None:
    gate, moving = threading.Event(), threading.Event()

    def move(request: Dwell) -> StopAccepted:
        moving.set()
        gate.wait(5.0)
        return StopAccepted(was_moving=False)

    hardware.serve(DWELL, move, lane="arm", refuse_when_busy=True)  # type: ignore[arg-type]
    hardware.serve(STOP, lambda request: StopAccepted(was_moving=True), lane=NOW_LANE)
    with Bus(hub.transport(), "c", "operator") as other:
        # the reply is not of DWELL's type: that is the asker's to see, and not what is tested here
        first = threading.Thread(target=lambda: _ask_and_ignore(planning))
        first.start()
        assert moving.wait(5.0)
        assert hardware.busy
        refusals = other.latest(REFUSAL)
        with pytest.raises(CommandRefused, match="busy"):
            other.call(DWELL, Dwell(duration_s=1), 1.0)
        said = refusals.wait_for(lambda refusal: refusal.refused == "busy", 5.0)
        assert said is not None and (said.command, said.request_seq) == (DWELL.path, -1)
        assert other.call(STOP, StopMotion(), 1.0).was_moving
        gate.set()
        first.join(5.0)
        assert not first.is_alive()


def test_the_clock_moves_by_the_bus_alone_and_starts_anew_with_the_cell(hardware: Bus, planning: Bus) -> None:
    ticks = hardware.publisher(CLOCK)
    ticks.publish(CellClock(stamp_ns=500, boot_id="a", realtime=False))
    assert planning.clock.now_ns() == 500
    ticks.publish(CellClock(stamp_ns=400, boot_id="a", realtime=False))
    assert planning.clock.now_ns() == 500
    ticks.publish(CellClock(stamp_ns=20, boot_id="b", realtime=False))
    assert planning.clock.now_ns() == 20


def test_liveliness_comes_and_goes(hub: MemoryHub, planning: Bus) -> None:
    seen: list[tuple[str, bool]] = []
    planning.watch_alive(lambda service, alive: seen.append((service, alive)))
    vision = Bus(hub.transport(), "c", "vision")
    vision.declare_alive()
    vision.close()
    assert seen == [("vision", True), ("vision", False)]


def test_close_twice_and_nothing_left_running(hub: MemoryHub) -> None:
    before = threading.active_count()
    bus = Bus(hub.transport(), "c", "vision")
    bus.subscribe(JOINT_STATE, lambda state: None)
    bus.serve(STOP, lambda request: StopAccepted(was_moving=False))
    bus.close()
    bus.close()
    assert threading.active_count() == before
