"""How late this machine wakes a process that has a deadline, and whether its clocks agree.

`python -m services.operator.doctor.clocks [urgent]`: measured in that process, printed as JSON. An arm's loop runs as a
normal process; the process that sends the holder's beats asks for a higher priority. Both are measured at the same
time.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from crosspih_common.service.urgency import be_urgent
from services.operator.cli.rows import Row, ok, warning, wrong
from services.operator.other_services.beside import run_module

MEASURE_S = 0.6
TIMER_S = 0.001
LATE_S = 0.005  # 99th percentile: beyond it an arm's loop of 2 to 8 ms misses cycles
BEAT_LATE_S = 0.02  # beats go out every 20 ms
STEPPED_S = 0.002  # difference of the wall clock to the monotonic one while measured
URGENT = "urgent"


def measure(urgent: bool, duration_s: float = MEASURE_S) -> dict[str, Any]:
    """Lateness of a 1 ms timer, s, and both clocks over that time."""
    granted = be_urgent() if urgent else ""
    began_ns, wall_ns = time.monotonic_ns(), time.time_ns()
    late, due = [], time.monotonic()
    while (now := time.monotonic()) - began_ns * 1e-9 < duration_s:
        due = max(due + TIMER_S, now)
        time.sleep(max(due - time.monotonic(), 0.0))
        late.append(time.monotonic() - due)
    ended_ns, wall_end_ns = time.monotonic_ns(), time.time_ns()
    return {
        "late_s": sorted(late),
        "granted": granted,
        "began_ns": began_ns,
        "ended_ns": ended_ns,
        "stepped_s": abs((wall_end_ns - wall_ns) - (ended_ns - began_ns)) * 1e-9,
    }


def clock_rows(holder_timeout_s: float) -> Iterator[Row]:
    """The rows from two processes that measure at the same time."""
    before_ns = time.monotonic_ns()
    asked: tuple[tuple[str, ...], ...] = ((), (URGENT,))
    with ThreadPoolExecutor(len(asked)) as pool:
        said = [pool.submit(run_module, "services.operator.doctor.clocks", *words) for words in asked]
        found = [one.result().value for one in said]
    measured = [one for one in found if isinstance(one, dict)]
    if len(measured) < len(asked):
        yield warning("timer", "the processes that measure it did not start", "see the rows of packages and wheels")
        return
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    plain, urgent = measured
    yield timer_row("timer", plain["late_s"], LATE_S, holder_timeout_s, load, os.cpu_count() or 1)
    yield timer_row("timer of beats", urgent["late_s"], BEAT_LATE_S, holder_timeout_s, load, os.cpu_count() or 1)
    yield one_time_row(before_ns, measured, time.monotonic_ns())
    yield wall_row(max(one["stepped_s"] for one in measured))
    yield urgency_row(urgent["granted"])


def timer_row(
    name: str, late_s: Sequence[float], most_s: float, holder_timeout_s: float, load: float, cores: int
) -> Row:
    """How late a 1 ms timer is."""
    ranked = sorted(late_s)
    median, most, rare = ranked[len(ranked) // 2], ranked[-1], ranked[int(len(ranked) * 0.99)]
    found = (
        f"a timer of 1 ms is late by {median * 1e3:.2f} ms (p50), {rare * 1e3:.2f} ms (p99), {most * 1e3:.1f} ms at "
        f"most; load {load:.1f} on {cores} cores"
    )
    quiet = "end what else runs on this machine, or use another"
    if rare > holder_timeout_s:
        return wrong(name, found, f"{quiet}: the arm stops where its holder is silent for {holder_timeout_s:g} s")
    if rare > most_s:
        return warning(name, found, f"{quiet}; cycles of the arm, or beats of its holder, come late")
    return ok(name, found)


def one_time_row(before_ns: int, measured: Sequence[dict[str, Any]], after_ns: int) -> Row:
    """Whether processes agree on the monotonic clock."""
    if all(before_ns <= one["began_ns"] <= one["ended_ns"] <= after_ns for one in measured):
        return ok("clock of all processes", "the monotonic clock is one for all")
    return wrong(
        "clock of all processes", "processes have monotonic clocks of their own",
        "run all services in one container or machine: the cell has one clock",
    )  # fmt: skip


def wall_row(stepped_s: float) -> Row:
    """Whether the wall clock runs at the rate of the monotonic one."""
    if stepped_s > STEPPED_S:
        return warning(
            "wall clock", f"moved by {stepped_s * 1e3:.1f} ms against the monotonic one within {MEASURE_S:g} s",
            "let NTP settle; dates of recordings and devices with their own clock are off meanwhile",
        )  # fmt: skip
    return ok("wall clock", f"goes with the monotonic one within {stepped_s * 1e6:.0f} us")


def urgency_row(granted: str) -> Row:
    """Whether a process may raise its own priority."""
    if granted == "real time":
        return ok("real-time priority", "granted")
    mend = "ulimit -r 10, or LimitRTPRIO=10 in its systemd unit, or run as root; see docs/safety.md"
    found = f"refused; {granted} is granted" if granted else "refused, and so is a better nice value"
    return warning("real-time priority", found, mend)


if __name__ == "__main__":
    print(json.dumps(measure(URGENT in sys.argv[1:])))
    sys.exit(0)
