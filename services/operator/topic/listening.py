"""A listener on the bus: the samples of one topic, in order, and which services are alive."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.bus.codec import decode, label_of
from crosspih_common.bus.traffic import KeyCounters
from crosspih_common.bus.transport import Tap
from crosspih_common.config import cell_name
from crosspih_common.errors import ContractError
from crosspih_common.keys import Payload, Topic
from services.operator.cell.which_cell import cell_path, endpoint
from services.operator.topic.naming import sender_of, shown

CONNECT_S = 2.0
HEAR_S = 1.0  # how long to wait for the router's answer about which services are alive
SILENCE_S = 3.0  # after this time without a sample a note is printed
KEPT = 20_000  # the most samples that may wait to be shown; later ones are dropped here, and counted


@dataclass(frozen=True, slots=True)
class ReceivedSample:
    """One sample as it came: whole key, payload, the publisher's number (-1: none), and the time on a clock of this
    machine.
    """

    key: str
    payload: bytes
    number: int
    at_s: float


@contextmanager
def listening_bus() -> Iterator[Bus]:
    """A bus that claims no service's name. Raises BusUnreachable and ConfigError."""
    name = cell_name(cell_path())
    with Bus(open_zenoh(endpoint(), CONNECT_S), name, "operator", claim=False) as bus:
        yield bus


def alive_services(bus: Bus, wanted: frozenset[str], wait_s: float = HEAR_S) -> set[str]:
    """The services with a liveliness token, after a short wait for all of those wanted."""
    alive: set[str] = set()
    changed = threading.Condition()

    def on_alive(service: str, lives: bool) -> None:
        with changed:
            (alive.add if lives else alive.discard)(service)
            changed.notify_all()

    bus.watch_alive(on_alive)
    with changed:
        changed.wait_for(lambda: wanted <= alive, wait_s)
        return set(alive)


class TopicStream:
    """The samples of a topic from now on; for a state also the last one."""

    def __init__(self, bus: Bus, topic: Topic[Any]) -> None:
        self._bus, self._topic = bus, topic
        self._label = label_of(topic.type)
        self._queue: queue.Queue[ReceivedSample] = queue.Queue(KEPT)
        self.overflowed = 0
        bus.tap(topic, self._taker)

    def _taker(self, key: str, counts: KeyCounters) -> Tap:
        def take(payload: bytes, number: int) -> None:
            try:
                self._queue.put_nowait(ReceivedSample(key, payload, number, time.monotonic()))
            except queue.Full:
                self.overflowed += 1

        return take

    def next(self, wait_s: float) -> ReceivedSample | None:
        """The next sample; None when none comes within the time."""
        try:
            return self._queue.get(timeout=max(wait_s, 0.0))
        except queue.Empty:
            return None

    def decoded(self, heard: ReceivedSample) -> Payload | str:
        """The message of a sample, or a text why it is not valid."""
        try:
            payload: Payload = decode(self._topic.type, heard.payload, self._label, heard.key)
        except ContractError as error:
            return str(error)
        return payload

    def why_silent(self) -> str:
        """The likely reason why nothing comes."""
        topic, sender, path = self._topic, sender_of(self._topic), shown(self._topic)
        if sender is None:
            return f"nothing on {path} yet"
        alive = sender in alive_services(self._bus, frozenset([sender]))
        if not alive:
            return f"nothing on {path}: {sender}, which sends it, is not alive (`crosspih ps`)"
        when = "sent when it happens" if topic.rate_hz is None else f"{topic.rate_hz:g} Hz when the cell's clock runs"
        return f"nothing on {path} yet: {sender} is alive; {topic.kind.value}, {when}"


def each_sample(
    stream: TopicStream, until: Callable[[], bool], seconds: float | None, say: Callable[[str], object],
    every_s: float | None = None, on_pause: Callable[[], object] = lambda: None,
) -> Iterator[ReceivedSample]:  # fmt: skip
    """Samples until `until`, or for `seconds`. Reports silence once; calls `on_pause` every `every_s`."""
    began_s = last_pause_s = time.monotonic()
    silent, heard_any = False, False
    while not until():
        now_s = time.monotonic()
        left_s = float("inf") if seconds is None else began_s + seconds - now_s
        if left_s <= 0.0:
            return
        if every_s is not None and now_s - last_pause_s >= every_s:
            last_pause_s = now_s
            on_pause()
        if not heard_any and not silent and now_s - began_s > SILENCE_S:
            silent = True
            say(stream.why_silent())
        heard = stream.next(min(left_s, 0.1))
        if heard is not None:
            heard_any = True
            yield heard
