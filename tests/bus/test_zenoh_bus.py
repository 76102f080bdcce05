"""The typed bus over real Zenoh on loopback, between real processes: what goes wrong must be told, never hang."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.errors import BusUnreachable, CommandRefused, CommandTimeout, NoService, NotSent
from crosspih_common.keys import EVENTS, IMAGE_LEFT, JOINT_STATE, LOCATE, STOP
from crosspih_common.messages import (
    Event,
    Image,
    JointState,
    LocateHole,
    Severity,
    StopAccepted,
    StopMotion,
)
from tests.conftest import START_S, Router, ServiceProcess

ZEROS = (0.0,) * 6
DEADLINE_S = 60.0  # a process reads its imports for half a minute beside twenty busy ones


def wait_until(condition: Callable[[], bool], what: str, deadline_s: float = DEADLINE_S) -> None:
    """Wait for a condition; fail the test at the deadline."""
    until = time.monotonic() + deadline_s
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < until, f"not within {deadline_s} s: {what}"
        pause.wait(0.01)


def ask_until_there(bus: Bus) -> StopAccepted:
    """A declaration takes a moment to reach the router; it is waited for."""
    return bus.call(STOP, StopMotion(), DEADLINE_S)


@pytest.fixture
def pair(endpoint: str) -> Iterator[tuple[Bus, Bus]]:
    with Bus(open_zenoh(endpoint), "c", "hardware") as hardware, Bus(open_zenoh(endpoint), "c", "planning") as planning:
        yield hardware, planning


def test_samples_cross_in_order(pair: tuple[Bus, Bus]) -> None:
    hardware, planning = pair
    got: list[JointState] = []
    planning.subscribe(JOINT_STATE, got.append)
    publisher = hardware.publisher(JOINT_STATE)

    def publish_one() -> bool:
        publisher.publish(JointState(joints_rad=ZEROS, speeds_rad_s=ZEROS))
        return bool(got)

    wait_until(publish_one, "the subscription reaches the publisher")
    wait_until(lambda: planning.traffic.total("received") == publisher._seq - got[0].seq, "all that was sent is here")
    start = publisher._seq
    for _ in range(500):
        publisher.publish(JointState(joints_rad=ZEROS, speeds_rad_s=ZEROS))
    wait_until(lambda: got[-1].seq == start + 499, "the last sample")
    assert [state.seq for state in got] == list(range(got[0].seq, start + 500))


def test_refusal_timeout_and_absence_are_told_apart(pair: tuple[Bus, Bus]) -> None:
    hardware, planning = pair
    with pytest.raises(NoService, match="nobody answers"):
        planning.call(STOP, StopMotion(), 0.2)
    gate = threading.Event()
    answers: list[Callable[[], StopAccepted]] = []

    def serve(request: StopMotion) -> StopAccepted:
        return answers[-1]()

    def refuse() -> StopAccepted:
        raise CommandRefused("limit", "too far")

    def wait_for_gate() -> StopAccepted:
        gate.wait(DEADLINE_S)
        return StopAccepted(was_moving=False)

    answers.append(lambda: StopAccepted(was_moving=True))
    hardware.serve(STOP, serve)
    assert ask_until_there(planning).was_moving
    answers.append(refuse)
    with pytest.raises(CommandRefused, match="limit: too far"):
        planning.call(STOP, StopMotion(), 5.0)
    answers.append(wait_for_gate)
    with pytest.raises(CommandTimeout):
        planning.call(STOP, StopMotion(), 0.1)
    gate.set()


def test_events_reach_a_late_reader(pair: tuple[Bus, Bus], endpoint: str) -> None:
    hardware, _ = pair
    hardware.publisher(EVENTS).publish(Event(service="hardware", severity=Severity.INFO, code="a", text="b"))
    with Bus(open_zenoh(endpoint), "c", "operator") as late:
        assert late.latest(EVENTS).wait_for(lambda event: event.code == "a", DEADLINE_S) is not None


def test_a_stranger_on_a_key_is_rejected_and_named(pair: tuple[Bus, Bus], endpoint: str) -> None:
    _, planning = pair
    planning.latest(JOINT_STATE)
    stranger = open_zenoh(endpoint)
    sender = stranger.sender(JOINT_STATE.key("c"), recover=False, history=0)

    def send() -> bool:
        sender.put(b"\xff\x00 garbage", "their.Type/9 0")
        return planning.traffic.total("rejected") > 0

    wait_until(send, "the garbage arrives")
    assert "their.Type/9" in planning.traffic.last_rejection
    assert "crosspih.JointState/1" in planning.traffic.last_rejection
    stranger.close()


SERVER = """
import sys, threading
from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.keys import LOCATE
with Bus(open_zenoh(sys.argv[1]), "c", "vision") as bus:
    def hold(request):
        print("asked", flush=True)
        threading.Event().wait()
    bus.serve(LOCATE, hold)
    bus.declare_alive()
    threading.Event().wait()
"""


def test_a_label_that_is_no_text_is_rejected_and_counted(pair: tuple[Bus, Bus], endpoint: str) -> None:
    """On a topic and in a request: an attachment that is not UTF-8, and none at all."""
    hardware, planning = pair
    states = planning.latest(JOINT_STATE)
    hardware.serve(STOP, lambda request: StopAccepted(was_moving=False))
    ask_until_there(planning)
    with open_zenoh(endpoint) as stranger:
        for attachment in (b"\xff\xfe\x80", None):
            before = planning.traffic.total("rejected")

            def put_one(attachment: bytes | None = attachment, before: int = before) -> bool:
                stranger.session.put(JOINT_STATE.key("c"), b"{}", attachment=attachment)
                return planning.traffic.total("rejected") > before

            wait_until(put_one, "the sample is rejected")
            replies = list(stranger.session.get(STOP.key("c"), payload=b"{}", attachment=attachment))
            assert [reply.err.payload.to_bytes().split(b"\n")[0] for reply in replies if reply.err] == [b"contract"]
    assert states.value() is None
    assert not ask_until_there(planning).was_moving


def test_a_server_killed_while_it_thinks_ends_the_wait(pair: tuple[Bus, Bus], endpoint: str) -> None:
    _, planning = pair
    alive: set[str] = set()
    planning.watch_alive(lambda service, here: alive.add(service) if here else alive.discard(service))
    with subprocess.Popen([sys.executable, "-c", SERVER, endpoint], stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        asked = server.stdout
        try:
            wait_until(lambda: "vision" in alive, "the server lives", START_S)

            def kill_when_asked() -> None:
                asked.readline()
                server.kill()

            killer = threading.Thread(target=kill_when_asked)
            killer.start()
            with pytest.raises(NoService, match="ended without a word"):
                planning.call(LOCATE, LocateHole(), 60.0)
            killer.join(DEADLINE_S)
        finally:
            server.kill()  # or nobody would end it where the test has failed
    wait_until(lambda: "vision" not in alive, "its token goes")


ANSWERER = """
import sys, threading
from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.errors import CommandRefused
from crosspih_common.keys import LOCATE
with Bus(open_zenoh(sys.argv[1]), "c", "vision") as bus:
    def answer(request):
        print("asked", flush=True)
        sys.stdin.readline()
        raise CommandRefused("no_cross", "nothing there")
    bus.serve(LOCATE, answer)
    bus.declare_alive()
    print("up", flush=True)
    threading.Event().wait()
"""


def test_a_server_that_hangs_loses_its_token_and_nothing_else(pair: tuple[Bus, Bus], endpoint: str) -> None:
    """SIGSTOP until its token is gone: the token comes back, and what it was asked is answered."""
    _, planning = pair
    heard: list[bool] = []
    planning.watch_alive(lambda service, here: heard.append(here) if service == "vision" else None)
    command = [sys.executable, "-c", ANSWERER, endpoint]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdin is not None and server.stdout is not None
        try:
            assert server.stdout.readline() == "up\n"
            wait_until(lambda: heard == [True], "the server lives")
            with ThreadPoolExecutor(1) as pool:
                answer = pool.submit(planning.call, LOCATE, LocateHole(), 60.0)
                assert server.stdout.readline() == "asked\n"
                server.send_signal(signal.SIGSTOP)
                wait_until(lambda: heard == [True, False], "its token goes")
                server.send_signal(signal.SIGCONT)
                wait_until(lambda: heard == [True, False, True], "its token comes back")
                server.stdin.write("\n")
                server.stdin.flush()
                with pytest.raises(CommandRefused, match="nothing there"):
                    answer.result(DEADLINE_S)
        finally:
            server.kill()


def test_everyone_comes_back_after_the_router_died(
    spawn: Callable[..., ServiceProcess], router: Router, pair: tuple[Bus, Bus]
) -> None:
    hardware, planning = pair
    hardware.serve(STOP, lambda request: StopAccepted(was_moving=True))
    assert ask_until_there(planning).was_moving
    router.process.kill()
    wait_until(lambda: not planning._transport.wait_served(STOP.key("c"), 0.0), "the router is missed")
    # what is asked while it is away waits for its return, and is answered once
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(planning.call, STOP, StopMotion(), 60.0, 60.0)
        spawn("router", "--endpoint", router.endpoint)
        assert answer.result(60.0).was_moving


def test_a_server_that_comes_late_is_waited_for(pair: tuple[Bus, Bus]) -> None:
    hardware, planning = pair
    with pytest.raises(NotSent):
        planning.call(STOP, StopMotion(), 5.0, 0.0)
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(planning.call, STOP, StopMotion(), DEADLINE_S)
        hardware.serve(STOP, lambda request: StopAccepted(was_moving=True))
        assert answer.result(DEADLINE_S).was_moving


def test_no_router_says_how_to_start_one() -> None:
    with pytest.raises(BusUnreachable, match="crosspih up"):
        open_zenoh("tcp/127.0.0.1:1", connect_timeout_s=0.2)


FORGETFUL = """
import sys
from crosspih_common.bus import Bus, closing, open_zenoh
from crosspih_common.keys import JOINT_STATE
from crosspih_common.service.ending import end_process
closing.CLOSE_S = 1e3  # nothing may wait as long as it is allowed to
bus = Bus(open_zenoh(sys.argv[1]), "c", "vision")
bus.subscribe(JOINT_STATE, print)
{end}
"""


@pytest.mark.parametrize(("end", "status"), [("", 0), ("raise SystemExit(3)", 3), ("1/0", 1), ("end_process(3)", 3)])
def test_a_forgotten_close_does_not_hang_the_exit(endpoint: str, end: str, status: int) -> None:
    code = FORGETFUL.format(end=end)
    done = subprocess.run([sys.executable, "-c", code, endpoint], timeout=DEADLINE_S, capture_output=True, check=False)
    assert done.returncode == status


def test_a_large_message_leaves_no_memory_shared(pair: tuple[Bus, Bus]) -> None:
    """Else each session that ever sent one costs the router and its reader 16 MB for good."""
    hardware, planning = pair
    maps = Path("/proc/self/maps")
    before = maps.read_text(encoding="utf-8").count(".zenoh")  # of a session of before, of another kind
    pictures = planning.latest(IMAGE_LEFT)
    hardware.publisher(IMAGE_LEFT).publish(Image("camera_left", np.zeros((480, 640), np.uint8)))
    assert pictures.wait_for(lambda picture: True, DEADLINE_S) is not None
    assert maps.read_text(encoding="utf-8").count(".zenoh") <= before
