"""Which services are there, whose clock it is, and whether the messages can be read. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crosspih_common.holding.soundness import boots
from crosspih_common.messages import CellClock
from services.operator.cli.rows import Row, ok, wrong

TICK_S = 0.02
TICK_TOLERANCE = 0.25
UNIX_NS = 10**18  # the year 2001: no machine's monotonic clock counts this far


def check_token(service: str, alive: bool, answers: bool) -> Row:
    """A service that answers must also have a liveliness token."""
    name = f"liveliness token of {service}"
    if alive:
        return ok(name, "declared")
    if answers:
        return wrong(
            name,
            f"{service} answers, but service/{service}/alive is not declared",
            "declare the token when the device is ready, for as long as it is (docs/wire.md): without it nobody "
            "notices when it dies",
        )
    return wrong(name, f"{service} is not there", "start it (`crosspih ps`, `crosspih logs`), or look at its router")


def check_one_cell(cell: str, ticks: Sequence[CellClock]) -> Row:
    """One boot id only."""
    name, heard = "one cell on its keys", boots(ticks)
    if len(heard) > 1:
        return wrong(
            name,
            f"{len(heard)} cells tick on the keys of {cell}: boot ids {', '.join(heard)}",
            "stop one of them, or give it another name (cell.name) or another router",
        )
    return ok(name, f"boot id {heard[0]}") if heard else wrong(name, "no clock is heard", "see the clock")


def check_clock(ticks: Sequence[CellClock]) -> Row:
    """Ticks of one boot, received while the arm was asked to hold still: 50 a second, increasing, no wall clock."""
    name = "clock"
    if not ticks:
        return wrong(name, "nobody ticks", "publish `clock` 50 times a second; is hardware up? (`crosspih ps`)")
    stamps = np.array([tick.stamp_ns for tick in ticks], dtype=np.int64)
    if stamps[-1] > UNIX_NS:
        return wrong(
            name, f"its time is {stamps[-1]} ns: the wall's (UNIX)", "stamp by a monotonic clock: the wall's is set"
        )
    steps = np.diff(stamps)
    if np.any(steps < 0):
        return wrong(name, f"it went back by {-steps.min() * 1e-9:.3f} s", "stamp by a clock that only goes onward")
    steps = steps[steps > 0]
    if len(steps) < 5:
        return wrong(name, f"{len(steps) + 1} ticks in a dwell", "tick 50 times a second of the cell's time")
    period_s = float(np.median(steps)) * 1e-9
    if abs(period_s / TICK_S - 1.0) > TICK_TOLERANCE:
        return wrong(name, f"{1.0 / period_s:.1f} ticks a second", "tick 50 times a second of the cell's time")
    return ok(name, f"{1.0 / period_s:.0f} ticks a second, {len(steps) + 1} heard")


def check_contract(rejected: Sequence[str]) -> Row:
    """Whether every sample could be read."""
    name = "messages as the contract says"
    if not rejected:
        return ok(name, "each sample could be read")
    return wrong(name, f"{len(rejected)} could not be read: {rejected[0][:300]}", "send as docs/wire.md says")
