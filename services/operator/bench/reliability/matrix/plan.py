"""Which process is ended when and how. Pure."""

from __future__ import annotations

import signal
from collections.abc import Iterable, Iterator
from enum import Enum
from typing import Any

from pydantic import BaseModel, ConfigDict

from crosspih_common.messages import Phase
from services.operator.bench.reliability.kills import plan as kills

RECORDER, OPERATOR = "recorder", "operator"
VICTIMS = (kills.ROUTER, *kills.SERVICES, OPERATOR)
PHASES = kills.PHASES
STOPPED_S = 7.0


class ProcessEnding(str, Enum):
    """How a process is ended."""

    KILL = "SIGKILL"  # killed
    STOP = "SIGSTOP"  # stopped: it hangs for STOPPED_S, and continues
    TERM = "SIGTERM"  # terminated: it ends in order, though no part of this system asked it to

    @property
    def number(self) -> signal.Signals:
        """The signal itself."""
        return signal.Signals[self.value]

    @property
    def text(self) -> str:
        """For people."""
        return f"{self.value} {STOPPED_S:g} s" if self is ProcessEnding.STOP else self.value


class MatrixCase(BaseModel):
    """One process ended in one phase. `seed` draws the hole."""

    model_config = ConfigDict(frozen=True)

    victim: str
    phase: Phase
    ending: ProcessEnding
    seed: int

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.victim} {self.ending.text} {self.phase.value}"

    @property
    def moment(self) -> kills.KillCase:
        """When: as in `crosspih bench kills`."""
        return kills.KillCase(service=self.victim, phase=self.phase, ending=kills.ServiceEnding.KILL, seed=self.seed)

    @property
    def overrides(self) -> dict[str, Any]:
        """Overrides of the cell's file."""
        return self.moment.overrides


def cases(
    victims: Iterable[str], phases: Iterable[Phase], endings: Iterable[ProcessEnding], seed: int
) -> Iterator[MatrixCase]:
    """All of them, in the order of the table."""
    phases, endings = tuple(phases), tuple(endings)
    for victim in victims:
        for ending in endings:
            for phase in phases:
                yield MatrixCase(victim=victim, phase=phase, ending=ending, seed=seed)
