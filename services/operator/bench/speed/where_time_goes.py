"""`crosspih bench trials`: where the wall time of a trial in `--speed max` goes."""

from __future__ import annotations

import os
import resource
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict
from rich.table import Table

from crosspih_common.bus import Bus
from crosspih_common.keys import CAPTURE, Topic
from crosspih_common.messages import Strategy
from deploy.launcher import StateDirectory
from services.operator.assembly.session import Session

RUN = "CROSSPIH_RUN_DIR"  # where OwnCell keeps the stack's state
OPERATOR = "operator"


class TrialTime(BaseModel):
    """One trial: its wall time, s, the CPU time of each process in it, and the part of the hardware's that made
    pictures.
    """

    model_config = ConfigDict(frozen=True)

    seed: int
    inserted: bool
    wall_s: float
    motion_s: float
    rendering_s: float
    cpu_s: dict[str, float]


class TrialsResult(BaseModel):
    """What `crosspih bench trials --json` prints: medians over the trials, s; the shares are of the wall time."""

    model_config = ConfigDict(frozen=True)

    trials: int
    inserted: int
    wall_s: float
    motion_s: float
    parts_s: dict[str, float]
    waiting_s: float
    each: list[TrialTime]


def cpu_of(stat: str, ticks_s: float) -> float:
    """User and system time, s, of a line of /proc/<pid>/stat; the process's name may hold spaces and brackets."""
    fields = stat.rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / ticks_s


def cpu_of_services(project: str, run_root: Path) -> dict[str, float]:
    """CPU time so far, s, of each process of a stack, and of this one as the operator. Linux."""
    own = resource.getrusage(resource.RUSAGE_SELF)
    found = {OPERATOR: own.ru_utime + own.ru_stime}
    state, ticks_s = StateDirectory(project, run_root).read(), float(os.sysconf("SC_CLK_TCK"))
    for row in () if state is None else state.services:
        if row.pid is not None:
            found[row.service] = cpu_of(Path(f"/proc/{row.pid}/stat").read_text(encoding="ascii"), ticks_s)
    return found


def _told_by(note: Callable[[], None]) -> Callable[[Any], None]:
    return lambda said: note()


class PictureTime:
    """The hardware's CPU time, s, between each request for pictures and its answer, as both are received on the bus."""

    def __init__(self, bus: Bus, project: str, run_root: Path) -> None:
        self._project, self._run_root = project, run_root
        self._asked_s: float | None = None
        self.cpu_s = 0.0
        echoes: dict[Topic[Any], Callable[[], None]] = {
            CAPTURE.request_echo: self._asked,
            CAPTURE.reply_echo: self._answered,
        }
        for echo, note in echoes.items():
            bus.subscribe_inline(echo, _told_by(note))

    def _now_s(self) -> float:
        return cpu_of_services(self._project, self._run_root).get("hardware", 0.0)

    def _asked(self) -> None:
        self._asked_s = self._now_s()

    def _answered(self) -> None:
        if self._asked_s is not None:
            self.cpu_s += self._now_s() - self._asked_s
            self._asked_s = None


@lru_cache(maxsize=8)
def pictures_of(bus: Bus, project: str, run_root: Path) -> PictureTime:
    """The one account of a cell's session: it listens for as long as the session lives."""
    return PictureTime(bus, project, run_root)


def accounted_trial(session: Session, payload: dict[str, Any]) -> dict[str, Any]:
    """One trial in a worker's cell; returns an Account as plain data. `payload` has seed and strategy."""
    project, run_root = session.cell.workcell.name, Path(os.environ[RUN])
    pictures = pictures_of(session.bus, project, run_root)
    before, pictures_before_s = cpu_of_services(project, run_root), pictures.cpu_s
    figures, _ = session.trial(payload["seed"], Strategy(payload["strategy"]), False)
    after, rendering_s = cpu_of_services(project, run_root), pictures.cpu_s - pictures_before_s
    return TrialTime(
        seed=payload["seed"], inserted=figures.inserted, wall_s=figures.wall_s, motion_s=figures.motion_s,
        rendering_s=rendering_s, cpu_s={name: after[name] - before.get(name, 0.0) for name in after},
    ).model_dump()  # fmt: skip


def result_of(accounts: list[TrialTime]) -> TrialsResult:
    """The medians. Waiting is the wall time minus all CPU time, for a cell that stays on one core."""
    names = sorted({name for one in accounts for name in one.cpu_s} - {"hardware"})

    def middle(values: list[float]) -> float:
        return float(np.median(values))

    parts = {
        "physics and control (hardware)": middle(
            [max(one.cpu_s.get("hardware", 0.0) - one.rendering_s, 0.0) for one in accounts]
        ),
        "rendering (hardware)": middle([one.rendering_s for one in accounts]),
        **{f"{name}": middle([one.cpu_s.get(name, 0.0) for one in accounts]) for name in names},
    }
    return TrialsResult(
        trials=len(accounts), inserted=sum(one.inserted for one in accounts),
        wall_s=middle([one.wall_s for one in accounts]), motion_s=middle([one.motion_s for one in accounts]),
        parts_s=parts, waiting_s=middle([max(one.wall_s - sum(one.cpu_s.values()), 0.0) for one in accounts]),
        each=accounts,
    )  # fmt: skip


def table_of(result: TrialsResult) -> Table:
    """A row a part."""
    table = Table(
        title=f"{result.trials} trials, {result.inserted} inserted; p50: {result.wall_s:.2f} s on the wall for "
        f"{result.motion_s:.1f} s of the cell's time"
    )
    for name in ("", "s", "of the wall time"):
        table.add_column(name, justify="left" if name == "" else "right")
    for name, seconds in {**result.parts_s, "waiting, for whatever": result.waiting_s}.items():
        table.add_row(name, f"{seconds:.3f}", f"{seconds / result.wall_s:.0%}")
    table.caption = "CPU time, but for waiting, which also holds what other processes took of the core"
    return table
