"""Checks before any motion: one clock, one cell on its keys, live sensor streams."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack

from crosspih_common.bus import Bus, Latest
from crosspih_common.errors import CommandRefused
from crosspih_common.keys import CLOCK, JOINT_STATE, WRENCH_RAW
from crosspih_common.messages import CellClock, JointState, MotionOutcome, RawWrenchBatch

UNFIT = "cell_unfit"
CLOCK_DEADLINE_S = 5.0
LISTEN_S = 0.3
TICKS_KEPT = 256
STREAM_DEADLINE_S = 3.0
DWELLS = 2  # a stream's first samples may pass before the subscription is active


def boots(ticks: Sequence[CellClock]) -> tuple[str, ...]:
    """The boot ids of the received ticks, in the order of their first tick."""
    return tuple(dict.fromkeys(tick.boot_id for tick in ticks))


def require_one_clock(bus: Bus) -> CellClock:
    """The cell's newest tick. Raises CommandRefused `cell_unfit` if no clock ticks, or those of two cells."""
    for attempt in range(2):
        with bus.reading(CLOCK, TICKS_KEPT) as clock:
            if clock.wait_for(lambda _: True, CLOCK_DEADLINE_S) is None:
                raise CommandRefused(
                    UNFIT,
                    "no clock: nobody tells the cell's time; is hardware up, and does it tick? (`crosspih ps`)",
                )
            # a clock that stands still between commands publishes its last tick again
            clock.wait_for(lambda _: len(boots(clock.values())) > 1, LISTEN_S)
            heard = boots(clock.values())
        if len(heard) == 1:
            return clock.values()[-1]
        if attempt == 0:
            continue  # the cell may have been started again just now
    raise CommandRefused(UNFIT, _two_cells(bus.cell, heard))


def require_not_doubled(cell: str, ticks: Sequence[CellClock]) -> None:
    """Raises CommandRefused `cell_unfit` when two cells tick: a boot id comes back after another one."""
    changes = [boot_id for boot_id, _ in itertools.groupby(tick.boot_id for tick in ticks)]
    if len(changes) > len(set(changes)):
        raise CommandRefused(UNFIT, _two_cells(cell, changes[-2:]))


def _two_cells(cell: str, boot_ids: Sequence[str]) -> str:
    return (
        f"two cells tick on the keys of {cell} (boot ids {', '.join(boot_ids)}): the one hears what the other does; "
        "stop one of them, or give it another name (cell.name) or router"
    )


class LiveStreams:
    """Subscribes to encoders and sensor for the length of a block, to detect a stream that stands still."""

    def __init__(self, bus: Bus) -> None:
        self._stack = ExitStack()
        self._joints = self._stack.enter_context(bus.reading(JOINT_STATE, 4))
        self._wrench = self._stack.enter_context(bus.reading(WRENCH_RAW, 4))

    def __enter__(self) -> LiveStreams:
        return self

    def __exit__(self, *exc: object) -> None:
        self._stack.close()

    def require_fresh(self, dwell: Callable[[], MotionOutcome]) -> MotionOutcome:
        """Let the arm dwell for a moment; both streams must have samples of it. Returns the outcome of the dwell.

        Raises CommandRefused `cell_unfit`, naming the stream and its age, and whatever `dwell` raises.
        """
        stale = ""
        for _ in range(DWELLS):
            outcome = dwell()
            stale = self._stale_since(outcome.start_stamp_ns)
            if not stale:
                return outcome
        raise CommandRefused(UNFIT, f"{stale}: nothing is moved by what is not seen; is its device up?")

    def _stale_since(self, since_ns: int) -> str:
        until = time.monotonic() + STREAM_DEADLINE_S / DWELLS
        each = (
            _stale(self._joints, since_ns, until, f"encoders ({JOINT_STATE.path})"),
            _stale(self._wrench, since_ns, until, f"force/torque sensor ({WRENCH_RAW.path})"),
        )
        return "; ".join(said for said in each if said)


def _stale(stream: Latest[JointState] | Latest[RawWrenchBatch], since_ns: int, until: float, what: str) -> str:
    fresh = stream.wait_for(lambda sample: sample.stamp_ns >= since_ns, max(until - time.monotonic(), 0.01))
    if fresh is not None:
        return ""
    last = stream.value()
    if last is None:
        return f"the {what} said nothing while the arm was asked to hold still"
    age_s = (since_ns - last.stamp_ns) * 1e-9
    return f"the {what} stood still while the arm was asked: the newest sample is {age_s:.2f} s old"


__all__ = ["TICKS_KEPT", "UNFIT", "LiveStreams", "require_not_doubled", "require_one_clock"]
