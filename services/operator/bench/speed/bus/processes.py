"""The two processes of the bench: this one sends, and its child listens and returns the samples received with their
times.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from crosspih_common.bus import open_zenoh
from crosspih_common.errors import CrosspihError
from crosspih_common.modules import module_command
from services.operator.bench.cells.own_cell import free_port
from services.operator.bench.cells.stopping import end_with_parent
from services.operator.bench.speed.bus import others
from services.operator.bench.speed.bus.figures import BusRound, turn_of
from services.operator.bench.speed.bus.ways import BusWay, installed_ways

READY_S = 120.0  # its imports take half a minute on a busy machine
PROBE_S = 0.01
QUIET_S = 3.0  # waiting time after the last sample received; a listener that waits for a core has lost nothing


def listen(endpoint: str, asked: Connection) -> None:
    """The child: listens by every way, and answers each `(way, last number)` with the samples received, number and
    time, ns, and with the CPU time that it has used so far, s.
    """
    end_with_parent()
    with ExitStack() as stack:
        heard: dict[str, dict[int, int]] = {}
        for name, way in installed_ways().items():
            times = heard[name] = {}
            way.listen(endpoint, _noted(times), stack)
        asked.send("ready")
        pause = threading.Event()
        while (question := asked.recv()) is not None:
            name, last = question
            times, quiet_at, known = heard[name], time.monotonic() + QUIET_S, -1
            while last not in times and time.monotonic() < quiet_at:
                if len(times) != known:
                    known, quiet_at = len(times), time.monotonic() + QUIET_S
                pause.wait(PROBE_S)
            cpu_s, told = time.process_time(), dict(times)
            times.clear()  # before the answer: the next samples come immediately after it
            asked.send((told, cpu_s))


def _noted(times: dict[int, int]) -> Callable[[int], None]:
    monotonic_ns = time.monotonic_ns

    def note(number: int) -> None:
        times[number] = monotonic_ns()

    return note


@contextmanager
def opened(folder: Path) -> Iterator[tuple[Callable[[BusWay, int, int, float], BusRound], dict[str, BusWay]]]:
    """A router of its own, a forwarder for ZeroMQ where that is installed, and the listener: (take a turn, the ways).

    Raises CrosspihError where the listener does not come up.
    """
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    spawn = multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        log = stack.enter_context((folder / "router.log").open("w"))
        router = subprocess.Popen(module_command("services.router", "--endpoint", endpoint), stdout=log, stderr=log)
        stack.callback(router.wait)
        stack.callback(router.terminate)
        open_zenoh(endpoint, READY_S).close()
        if "ZeroMQ" not in others.missing():
            os.environ[others.ZMQ_IN] = f"tcp://127.0.0.1:{free_port()}"
            os.environ[others.ZMQ_OUT] = f"tcp://127.0.0.1:{free_port()}"
            ends = os.environ[others.ZMQ_IN], os.environ[others.ZMQ_OUT]
            forwarder = spawn.Process(target=others.forward, args=ends, daemon=True)
            forwarder.start()
            stack.callback(forwarder.terminate)
        ours, theirs = spawn.Pipe()
        child = spawn.Process(target=listen, args=(endpoint, theirs), daemon=True)
        child.start()
        stack.callback(child.join, READY_S)
        stack.callback(ours.send, None)
        if not ours.poll(READY_S):
            raise CrosspihError("bench bus: the process that listens did not come up")
        ours.recv()
        ways = installed_ways()
        senders = {name: way.send(endpoint, stack) for name, way in ways.items()}
        for name, way in ways.items():
            _reaches(ours, way, senders[name])

        def take_turn(way: BusWay, steady: int, burst: int, rate_hz: float) -> BusRound:
            return _take_turn(ours, way, senders[way.name], steady, burst, rate_hz)

        yield take_turn, ways


def _reaches(ours: Connection, way: BusWay, send: Callable[[Any], object]) -> None:
    until = time.monotonic() + READY_S
    while time.monotonic() < until:
        for number in range(1, 4):
            send(way.sample(number))
        ours.send((way.name, 3))
        if ours.recv()[0]:
            return
    raise CrosspihError(f"bench bus: no sample of {way.name} arrived within {READY_S:g} s")


def _take_turn(
    ours: Connection, way: BusWay, send: Callable[[Any], object], steady: int, burst: int, rate_hz: float
) -> BusRound:
    monotonic_ns = time.monotonic_ns
    steady_ns: dict[int, int] = {}
    begun = time.monotonic()
    for number in range(1, steady + 1):
        sample = way.sample(number)
        time.sleep(max(begun + number / rate_hz - time.monotonic(), 0.0))
        steady_ns[number] = monotonic_ns()
        send(sample)
    ours.send((way.name, steady))
    heard: dict[int, int] = ours.recv()[0]
    ours.send((way.name, 0))  # the CPU time for answering is not part of the burst
    _, heard_before_s = ours.recv()
    samples = [(number, way.sample(number)) for number in range(steady + 1, steady + burst + 1)]
    burst_ns: dict[int, int] = {}
    sent_before_s = time.process_time()
    for number, sample in samples:
        burst_ns[number] = monotonic_ns()
        send(sample)
    sent_s = time.process_time()
    ours.send((way.name, steady + burst))
    late, heard_s = ours.recv()
    return turn_of(steady_ns, burst_ns, heard | late, (sent_s - sent_before_s, heard_s - heard_before_s))
