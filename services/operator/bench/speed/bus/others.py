"""Other buses for the same work, each only where its package is installed (the extra `bench-peers`). On loopback alone.

ZeroMQ goes through a forwarder in a process of its own, as Zenoh goes through its router; LCM (UDP multicast that does
not leave the machine) and CycloneDDS go from one process straight to the other.
"""

from __future__ import annotations

import importlib.util
import os
import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from services.operator.bench.cells.stopping import end_with_parent

PACKAGES = {"ZeroMQ": "zmq", "LCM": "lcm", "CycloneDDS": "cyclonedds"}
CHANNEL = "bench"
ZMQ_IN, ZMQ_OUT = "CROSSPIH_BENCH_ZMQ_IN", "CROSSPIH_BENCH_ZMQ_OUT"  # where the forwarder listens, for both processes
LCM_ROUTE = "udpm://239.255.76.67:7667?ttl=0"
DDS_ROUTE = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces></General>"
    "<Discovery><Peers><Peer address='localhost'/></Peers><ParticipantIndex>auto</ParticipantIndex></Discovery>"
    "</Domain></CycloneDDS>"
)
WAIT_MS = 100
NumberOf = Callable[[bytes], int]
Listen = Callable[[str, Callable[[int], None], ExitStack], None]
Send = Callable[[str, ExitStack], Callable[[Any], object]]


def installed(number_of: NumberOf) -> list[tuple[str, Listen, Send]]:
    """(name, listen, send) of each that is installed."""
    made = {"ZeroMQ": _zeromq, "LCM": _lcm, "CycloneDDS": _cyclonedds}
    return [
        (name, *made[name](number_of))
        for name, package in PACKAGES.items()
        if importlib.util.find_spec(package) is not None and (name != "ZeroMQ" or ZMQ_IN in os.environ)
    ]


def missing() -> list[str]:
    """The names of those that are not installed."""
    return [name for name, package in PACKAGES.items() if importlib.util.find_spec(package) is None]


def _until_closed(stack: ExitStack, step: Callable[[], object]) -> None:
    ended = threading.Event()

    def run() -> None:
        while not ended.is_set():
            step()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    stack.callback(thread.join, 2.0)
    stack.callback(ended.set)


def forward(into: str, out: str) -> None:
    """ZeroMQ's own forwarder, in a process of its own until that is ended."""
    end_with_parent()
    import zmq

    context: Any = zmq.Context()
    front, back = context.socket(zmq.XSUB), context.socket(zmq.XPUB)
    for socket, endpoint in ((front, into), (back, out)):
        socket.set_hwm(100_000)
        socket.bind(endpoint)
    zmq.proxy(front, back)


def _zeromq(number_of: NumberOf) -> tuple[Listen, Send]:
    import zmq

    def listen(endpoint: str, heard: Callable[[int], None], stack: ExitStack) -> None:
        context: Any = zmq.Context()
        socket = context.socket(zmq.SUB)
        socket.set_hwm(100_000)
        socket.setsockopt(zmq.SUBSCRIBE, b"")
        socket.setsockopt(zmq.RCVTIMEO, WAIT_MS)
        socket.connect(os.environ[ZMQ_OUT])
        stack.callback(context.destroy, 0)

        def step() -> None:
            try:
                heard(number_of(socket.recv()))
            except zmq.Again:
                return

        _until_closed(stack, step)

    def send(endpoint: str, stack: ExitStack) -> Callable[[Any], object]:
        context: Any = zmq.Context()
        socket = context.socket(zmq.PUB)
        socket.set_hwm(100_000)
        socket.connect(os.environ[ZMQ_IN])
        stack.callback(context.destroy, 0)
        return lambda payload: socket.send(payload)

    return listen, send


def _lcm(number_of: NumberOf) -> tuple[Listen, Send]:
    import lcm

    def listen(endpoint: str, heard: Callable[[int], None], stack: ExitStack) -> None:
        line = lcm.LCM(LCM_ROUTE)
        subscription = line.subscribe(CHANNEL, lambda channel, payload: heard(number_of(payload)))
        subscription.set_queue_capacity(0)
        _until_closed(stack, lambda: line.handle_timeout(WAIT_MS))

    def send(endpoint: str, stack: ExitStack) -> Callable[[Any], object]:
        line = lcm.LCM(LCM_ROUTE)
        return lambda payload: line.publish(CHANNEL, payload)

    return listen, send


def _cyclonedds(number_of: NumberOf) -> tuple[Listen, Send]:
    os.environ.setdefault("CYCLONEDDS_URI", DDS_ROUTE)
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import make_idl_struct
    from cyclonedds.idl.types import sequence, uint8
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    kind = make_idl_struct("Payload", "bench.Payload", {"data": sequence[uint8]})
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepAll)

    def listen(endpoint: str, heard: Callable[[int], None], stack: ExitStack) -> None:
        participant = DomainParticipant(0)
        reader = DataReader(participant, Topic(participant, CHANNEL, kind), qos=qos)

        def step() -> None:
            for sample in reader.take_iter(timeout=duration(milliseconds=WAIT_MS)):
                heard(number_of(bytes(sample.data)))

        _until_closed(stack, step)

    def send(endpoint: str, stack: ExitStack) -> Callable[[Any], object]:
        participant = DomainParticipant(0)
        writer = DataWriter(participant, Topic(participant, CHANNEL, kind), qos=qos)
        return lambda payload: writer.write(kind(data=payload))

    return listen, send
