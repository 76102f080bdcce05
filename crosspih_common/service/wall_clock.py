"""How far this machine's wall clock is from that of the cell's machine, bounded from both sides.

Stamps use the cell's clock, never a wall clock. The log times of recordings and logs, and the dates of calibrations,
use each machine's wall clock: if two of these differ, such times cannot be compared.

The cell's machine is asked for its time. Its answer was made between the question and its arrival here, so the
difference is known to half the round trip, however the way there and the way back differ (Cristian 1989). Several such
answers together say more than the best of them: the difference lies within each.
"""

from __future__ import annotations

import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from crosspih_common.bus import Bus
from crosspih_common.errors import CrosspihError
from crosspih_common.keys import WALL_CLOCK
from crosspih_common.messages import AskWallClock

KEPT = 8
DRIFT = 1e-4  # upper bound of the drift between two clocks that nobody sets, s per second
END_S = 0.5
FIRST_S, PERIOD_S = 1.0, 10.0  # between the first KEPT exchanges, and after them
ASK_S = 2.0
# Beyond the bound: what NTP keeps in any building is ten times less, and what log times are used for, to tell which of
# two things on two machines came first, bears no more.
APART_S = 0.02


def this_host() -> str:
    """The name of this machine."""
    return socket.gethostname()


@dataclass(frozen=True, slots=True)
class Exchange:
    """One exchange: local wall clock at request and answer, ns; remote wall clock, ns; local monotonic time, s."""

    sent_ns: int
    there_ns: int
    back_ns: int
    at_s: float

    @property
    def offset_s(self) -> float:
        """The local clock minus the remote one, if both ways take equally long, s."""
        return (0.5 * (self.sent_ns + self.back_ns) - self.there_ns) * 1e-9

    @property
    def bound_s(self) -> float:
        """The largest possible error of `offset_s`, s."""
        return 0.5 * (self.back_ns - self.sent_ns) * 1e-9


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """The wall clock here minus that of the cell's machine `host`: `offset_s`, give or take `bound_s`."""

    offset_s: float
    bound_s: float
    host: str

    @property
    def least_s(self) -> float:
        """The least possible difference of the two clocks, s."""
        return max(abs(self.offset_s) - self.bound_s, 0.0)

    def __str__(self) -> str:
        way = "ahead of" if self.offset_s > 0.0 else "behind"
        return (
            f"the wall clock of {this_host()} is {abs(self.offset_s) * 1e3:.0f} ms {way} that of the cell's machine, "
            f"{self.host} (± {self.bound_s * 1e3:.0f} ms)"
        )


def narrowed(exchanges: Sequence[Exchange], host: str) -> ClockOffset | None:
    """The offset that agrees with all exchanges, oldest first; exchanges from before a clock was set do not count."""
    if not exchanges:
        return None
    newest = exchanges[-1]
    low, high = newest.offset_s - newest.bound_s, newest.offset_s + newest.bound_s
    for one in reversed(exchanges[:-1]):
        wide_s = one.bound_s + DRIFT * (newest.at_s - one.at_s)
        tighter = max(low, one.offset_s - wide_s), min(high, one.offset_s + wide_s)
        if tighter[0] > tighter[1]:
            break
        low, high = tighter
    return ClockOffset(0.5 * (low + high), 0.5 * (high - low), host)


def exchange(bus: Bus, deadline_s: float = ASK_S) -> tuple[Exchange, str]:
    """Ask once; also the name of the cell's machine. Raises CrosspihError where nobody answers."""
    sent_ns, began_ns = time.time_ns(), time.monotonic_ns()
    answer = bus.call(WALL_CLOCK, AskWallClock(), deadline_s, 0.0)
    # by the monotonic clock: the wall clock may be set meanwhile
    now_ns = time.monotonic_ns()
    return Exchange(sent_ns, answer.wall_ns, sent_ns + now_ns - began_ns, now_ns * 1e-9), answer.host


def measured(bus: Bus, times: int = 4, deadline_s: float = ASK_S) -> ClockOffset | None:
    """The offset after `times` exchanges, one after the other; None if nobody answers."""
    found, host = [], ""
    try:
        for _ in range(times):
            one, host = exchange(bus, deadline_s)
            found.append(one)
    except CrosspihError:
        pass  # a cell that tells no wall clock, or is not there
    return narrowed(found, host)


class ClockWatch:
    """Measures the offset periodically, on a thread of its own; calls `tell(True)` when the clocks start to differ, and
    `tell(False)` when they agree again."""

    def __init__(self, bus: Bus, tell: Callable[[bool, ClockOffset], None]) -> None:
        self._bus, self._tell = bus, tell
        self._stop = threading.Event()
        self._kept: deque[Exchange] = deque(maxlen=KEPT)
        self._host = ""
        self._apart = False
        self.difference: ClockOffset | None = None
        self._thread = threading.Thread(target=self._run, name="wall-clock", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                one, host = exchange(self._bus)
            except CrosspihError:
                pass  # asked again; what was known stays, and grows no older than the next answer
            else:
                self._learn(one, host)
            self._stop.wait(FIRST_S if len(self._kept) < KEPT else PERIOD_S)

    def _learn(self, one: Exchange, host: str) -> None:
        if host != self._host:
            self._host = host
            self._kept.clear()
        self._kept.append(one)
        self.difference = found = narrowed(tuple(self._kept), host)
        assert found is not None
        apart = found.least_s > (0.5 * APART_S if self._apart else APART_S)
        if apart is not self._apart:
            self._apart = apart
            self._tell(apart, found)

    def close(self) -> None:
        """End the thread. Waits a moment for an open request: the interpreter must not end within Zenoh's code."""
        self._stop.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(END_S)
