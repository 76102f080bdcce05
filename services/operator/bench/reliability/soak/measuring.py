"""The figures after each assembly of a soak, and the complaints about the stack at the end."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from pydantic import BaseModel, ConfigDict

from crosspih_common.bus import Latest
from crosspih_common.errors import CrosspihError
from crosspih_common.keys import STATUS, WALL_CLOCK
from crosspih_common.messages import AskWallClock, ServiceStatus, Strategy
from services.operator.assembly.session import Session
from services.operator.bench.cells.processes import ProcessResources, held_by_services, restarts_of
from services.operator.bench.reliability.soak.trend import WARM_UP_SHARE, Growth, growth
from services.operator.scoring.score import seen_in_words

ASKED, ASK_DEADLINE_S = 40, 10.0
# growth of a process in a soak that is still allowed
DESCRIPTORS, THREADS, DISK_MB = 2.0, 2.0, 2.0
# Memory is judged by the second half. An allocator keeps the most that a process ever needed, and the rarest need may
# come late in the first half hour: resident memory rises in steps that become rarer, though nothing leaks
# (tests/vision/measure_memory.py). A real leak continues in the second half. Half the time, half the limit.
MEMORY_MB, MEMORY_WARM_UP = 2.0, 0.5
LATENCY_SHARE = 0.5


class Figures(BaseModel):
    """The figures after one assembly. `dropped` and `rejected` are the sums that each service counts itself since it
    started.
    """

    model_config = ConfigDict(frozen=True)

    at_s: float
    seed: int
    inserted: bool
    ended_as: str
    vision: str = ""  # what it had to do with it
    wall_s: float
    latency_ms: tuple[float, float]  # latency of a command that does nothing: median, 95 %
    services: dict[str, ProcessResources]
    restarts: dict[str, int]
    dropped: dict[str, int]
    rejected: dict[str, int]
    recorded_mb: float
    kept_mb: float  # state and logs of the stack, without recordings
    missing: tuple[str, ...]  # the warnings in the recording


def latency_ms(session: Session) -> tuple[float, float]:
    """From a request to its answer through the router: median and 95 %."""
    took = []
    for _ in range(ASKED):
        began = time.perf_counter()
        session.bus.call(WALL_CLOCK, AskWallClock(), ASK_DEADLINE_S)
        took.append((time.perf_counter() - began) * 1e3)
    return median(took), float(np.quantile(took, 0.95))


def size_mb(folder: Path) -> float:
    """The size of all files below a folder; a file that disappears meanwhile counts nothing."""
    total = 0
    for file in folder.rglob("*"):
        try:
            total += file.stat().st_size if file.is_file() else 0
        except OSError:
            continue
    return total / 1e6


def assembled(
    session: Session, statuses: Latest[ServiceStatus], seed: int, run: Path, keep: bool, began_s: float
) -> Figures:
    """One assembly, recorded, and the stack's resources after it. Its recording is removed unless it is to be kept."""
    started = time.monotonic()
    try:
        trial, _ = session.trial(seed, Strategy.FUSED, record=True)
        inserted, ended_as, vision = trial.inserted, trial.failure or "inserted", seen_in_words(trial)
        parts, missing = trial.recording_parts, trial.recording_warnings
    except CrosspihError as error:
        inserted, ended_as, parts, missing = False, f"{type(error).__name__}: {error}", (), ()
        vision = "no result"
    wall_s = time.monotonic() - started
    project = session.cell.workcell.name
    counts = {status.service: status for status in statuses.values()}
    recorded_mb = sum(Path(part).stat().st_size for part in parts if Path(part).exists()) / 1e6
    if not keep:
        for part in parts:
            Path(part).unlink(missing_ok=True)
    return Figures(
        at_s=time.monotonic() - began_s, seed=seed, inserted=inserted, ended_as=ended_as, vision=vision,
        wall_s=wall_s,
        latency_ms=latency_ms(session), services=held_by_services(project), restarts=restarts_of(project),
        dropped={name: status.dropped for name, status in counts.items()},
        rejected={name: status.rejected for name, status in counts.items()},
        recorded_mb=recorded_mb, kept_mb=size_mb(run), missing=missing,
    )  # fmt: skip


def statuses_of(session: Session) -> Latest[ServiceStatus]:
    """The newest statuses, enough to have each service's own."""
    return session.bus.latest(STATUS, 64)


class Grown(BaseModel):
    """One figure over the soak: after the warm-up and at its end, its growth, and whether it is flat."""

    model_config = ConfigDict(frozen=True)

    what: str
    unit: str
    first: float
    last: float
    grown: float
    low: float
    high: float
    flat: bool


@dataclass(frozen=True, slots=True)
class _Figure:
    """A figure to judge: how to read it, how much it may grow, and the share at the beginning that does not count."""

    what: str
    unit: str
    read: Callable[[Figures], float]
    allowed: float
    warm_up: float = WARM_UP_SHARE


def grown(taken: Sequence[Figures]) -> list[Grown]:
    """For each service's memory, descriptors and threads, the latency, and the disk; empty for too few assemblies."""
    at_s = [one.at_s for one in taken]
    names = [name for name in taken[-1].services if all(name in one.services for one in taken)] if taken else []
    rows: list[_Figure] = []
    for name in names:
        rows += [
            _Figure(f"{name}: memory", "MB", _of(name, "memory_mb"), MEMORY_MB, MEMORY_WARM_UP),
            _Figure(f"{name}: descriptors", "", _of(name, "descriptors"), DESCRIPTORS),
            _Figure(f"{name}: threads", "", _of(name, "threads"), THREADS),
        ]
    if taken:
        usual_ms = median(one.latency_ms[0] for one in taken)
        rows.append(_Figure("latency of a command, p50", "ms", lambda one: one.latency_ms[0], LATENCY_SHARE * usual_ms))
    rows.append(_Figure("disk: state and logs", "MB", lambda one: one.kept_mb, DISK_MB))
    return list(_judged(at_s, taken, rows))


def _of(service: str, held: str) -> Callable[[Figures], float]:
    """Reads the resources of a service."""
    return lambda one: float(getattr(one.services[service], held))


def _judged(at_s: Sequence[float], taken: Sequence[Figures], rows: Sequence[_Figure]) -> Iterator[Grown]:
    for row in rows:
        found: Growth | None = growth(at_s, [row.read(one) for one in taken], row.warm_up)
        if found is not None:
            yield Grown(
                what=row.what, unit=row.unit, first=found.first, last=found.last, grown=found.grown, low=found.low,
                high=found.high, flat=not found.is_more_than(row.allowed),
            )  # fmt: skip


def complaints(taken: Sequence[Figures], rows: Sequence[Grown]) -> list[str]:
    """The complaints about the stack, in words; empty where there are none."""
    found = [f"{row.what} grows: {row.grown:+.1f} {row.unit} ({row.low:+.1f} to {row.high:+.1f})".replace("  ", " ")
             for row in rows if not row.flat]  # fmt: skip
    found += [f"seed {one.seed}: {one.ended_as}" for one in taken if not one.inserted]
    found += [f"seed {one.seed}: {said}" for one in taken for said in one.missing]
    if taken:
        last = taken[-1]
        found += [f"{name} dropped {count} samples" for name, count in last.dropped.items() if count]
        found += [f"{name} rejected {count} samples" for name, count in last.rejected.items() if count]
        found += [f"{name} was started again {count} times" for name, count in last.restarts.items() if count]
    return found
