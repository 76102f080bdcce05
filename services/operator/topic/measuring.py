"""`crosspih topic hz|delay|bw`: how often, how late and how large, over the newest messages, a line a second."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.bus import Bus
from crosspih_common.errors import CommandTimeout, ConfigError
from crosspih_common.keys import CLOCK, Topic
from crosspih_common.messages import CellClock
from services.operator.cli.failure import errors_shown
from services.operator.topic.listening import ReceivedSample, TopicStream, each_sample, listening_bus
from services.operator.topic.names import TopicName
from services.operator.topic.naming import chosen_topic, shown
from services.operator.topic.running import Arrivals, CellTimeOffset, Newest, Spread
from services.operator.topic.values import as_json_line

EVERY_S = 1.0
Window = Annotated[int, typer.Option(min=2, max=100_000, help="Over this many of the newest messages.")]
Seconds = Annotated[
    float | None, typer.Option(min=0.1, help="End after so long; status 1 where nothing came. Else Ctrl-C ends it.")
]
Count = Annotated[int | None, typer.Option("--count", "-n", min=2, help="End after this many messages.")]
Lines = Annotated[bool, typer.Option("--json", help="One line of JSON a second.")]


def milliseconds(spread: Spread) -> str:
    """Least, largest and standard deviation, as in `ros2 topic hz`."""
    return f"min {spread.least * 1e3:.2f} ms, max {spread.largest * 1e3:.2f} ms, sd {spread.sd * 1e3:.2f} ms"


def bytes_in_words(count: float) -> str:
    """412 B, 3.1 kB, 2.4 MB."""
    for unit, size in (("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count:.0f} B"


class _Measured:
    """One measurement over a topic: takes samples, and gives the values known so far."""

    def __init__(self, window: int) -> None:
        self.arrivals = Arrivals(window)

    def add(self, stream: TopicStream, heard: ReceivedSample) -> None:
        self.arrivals.add(heard.at_s, len(heard.payload), heard.number)


class _Delayed(_Measured):
    def __init__(self, window: int, bus: Bus) -> None:
        super().__init__(window)
        self._behind, self.cell_time = (
            Newest(window),
            CellTimeOffset(),
        )  # this machine's time minus stamp, s: two clocks with different origins
        self.refused = ""
        bus.subscribe_inline(CLOCK, self._tick)

    def _tick(self, tick: CellClock) -> None:
        if not tick.realtime:
            self.refused = "the cell runs at speed max: its clock does not run with ours; start it with realtime"
        self.cell_time.tick(tick.stamp_ns * 1e-9, time.monotonic(), tick.boot_id)

    def add(self, stream: TopicStream, heard: ReceivedSample) -> None:
        super().add(stream, heard)
        if self.refused:
            raise ConfigError(f"delay: {self.refused}")
        payload = stream.decoded(heard)
        if not isinstance(payload, str) and payload.stamp_ns >= 0:
            self._behind.add(heard.at_s - payload.stamp_ns * 1e-9)

    def delays(self) -> Spread | None:
        """In s, by all ticks that came so far; None before the first tick or message."""
        spread, offset_s = self._behind.spread(), self.cell_time.offset_s
        return None if spread is None or offset_s is None else spread.shifted(offset_s)


Values = dict[str, Any]


def rate_values(arrivals: Arrivals) -> Values:
    """What `hz --json` prints of it."""
    spread = arrivals.intervals()
    return {
        "rate_hz": arrivals.rate_hz(), "interval_s": None if spread is None else asdict(spread),
        "messages": arrivals.count, "missing": arrivals.missing,
    }  # fmt: skip


def rate_line(arrivals: Arrivals) -> str:
    """What `hz` prints of it."""
    spread, rate = arrivals.intervals(), arrivals.rate_hz()
    if spread is None or rate is None:
        return f"{arrivals.count} message so far: two are needed"
    missing = f", {arrivals.missing} missing" if arrivals.missing else ""
    return f"{rate:.2f} Hz: {milliseconds(spread)} over {spread.count + 1} messages{missing}"


def size_values(arrivals: Arrivals) -> Values:
    """What `bw --json` prints of it."""
    spread = arrivals.sizes()
    return {
        "bytes_a_second": arrivals.bytes_a_second(), "message_bytes": None if spread is None else asdict(spread),
        "messages": arrivals.count, "missing": arrivals.missing,
    }  # fmt: skip


def size_line(arrivals: Arrivals) -> str:
    """What `bw` prints of it."""
    spread, each_s = arrivals.sizes(), arrivals.bytes_a_second()
    if spread is None or each_s is None:
        return f"{arrivals.count} message so far: two are needed"
    least, mean, largest = (bytes_in_words(value) for value in (spread.least, spread.mean, spread.largest))
    return f"{bytes_in_words(each_s)}/s: {mean} a message (min {least}, max {largest}) over {spread.count + 1} messages"


def delay_values(measured: _Delayed) -> Values:
    """What `delay --json` prints of it."""
    spread = measured.delays()
    return {"delay_s": None if spread is None else asdict(spread), "messages": measured.arrivals.count}


def delay_line(measured: _Delayed) -> str:
    """What `delay` prints of it."""
    spread = measured.delays()
    if spread is None:
        return "no tick of the cell's clock yet"
    return f"{spread.mean * 1e3:.2f} ms: {milliseconds(spread)} over {spread.count} messages"


@contextmanager
def _stream(name: str) -> Iterator[tuple[Bus, Topic[Any], TopicStream]]:
    chosen = chosen_topic(name)
    with listening_bus() as bus:
        yield bus, chosen, TopicStream(bus, chosen)


def _measure(
    chosen: Topic[Any], stream: TopicStream, measured: _Measured, seconds: float | None, count: int | None,
    as_json: bool, line: Callable[[], str], values: Callable[[], Values],
) -> None:  # fmt: skip
    told_by = Console(stderr=True)

    def show() -> None:
        if measured.arrivals.count:
            sys.stdout.write(as_json_line({"topic": shown(chosen), **values()}) if as_json else line() + "\n")
            sys.stdout.flush()

    def enough() -> bool:
        return count is not None and measured.arrivals.count >= count

    def say(text: str) -> None:
        told_by.print(text, style="yellow", highlight=False, soft_wrap=True)

    for heard in each_sample(stream, enough, seconds, say, EVERY_S, show):
        measured.add(stream, heard)
    show()
    if not measured.arrivals.count:
        raise CommandTimeout(f"nothing came on {shown(chosen)} within {seconds:g} s")


def hz(
    name: TopicName, window: Window = 1000, seconds: Seconds = None, count: Count = None, as_json: Lines = False
) -> None:
    """How often messages come: rate, shortest and longest pause, its standard deviation, and how many are missing."""
    with errors_shown(Console(stderr=True)), _stream(name) as (_, chosen, stream):
        measured = _Measured(window)
        arrivals = measured.arrivals
        _measure(chosen, stream, measured, seconds, count, as_json,
                 lambda: rate_line(arrivals), lambda: rate_values(arrivals))  # fmt: skip


def bw(
    name: TopicName, window: Window = 1000, seconds: Seconds = None, count: Count = None, as_json: Lines = False
) -> None:
    """How much travels: bytes of payload a second, and a message's least, mean and largest size."""
    with errors_shown(Console(stderr=True)), _stream(name) as (_, chosen, stream):
        measured = _Measured(window)
        arrivals = measured.arrivals
        _measure(chosen, stream, measured, seconds, count, as_json,
                 lambda: size_line(arrivals), lambda: size_values(arrivals))  # fmt: skip


def delay(
    name: TopicName, window: Window = 1000, seconds: Seconds = None, count: Count = None, as_json: Lines = False
) -> None:
    """How late messages come here: from the stamp on the cell's clock, which has to run in real time.

    The cell's time is told here by the fastest tick of its clock that came, so the delay is beyond what that one
    needed. A stamp says when something was measured: of ft/raw it is the first sample's of a batch of 10 ms.
    """
    with errors_shown(Console(stderr=True)), _stream(name) as (bus, chosen, stream):
        measured = _Delayed(window, bus)
        _measure(chosen, stream, measured, seconds, count, as_json,
                 lambda: delay_line(measured), lambda: delay_values(measured))  # fmt: skip
