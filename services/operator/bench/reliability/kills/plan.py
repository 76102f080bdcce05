"""Which service is ended when and how, and the cells in which this is done. Pure."""

from __future__ import annotations

import signal
from collections.abc import Iterable, Iterator
from enum import Enum
from typing import Any

from pydantic import BaseModel, ConfigDict

from crosspih_common.messages import AssemblyPhase, Phase, Strategy

SERVICES = ("planning", "vision", "inference", "force_torque", "hardware", "recorder")
ROUTER = "router"
COMPUTING = ("vision", "inference", "force_torque")
PHASES = (Phase.LOCATING, Phase.APPROACHING, Phase.PUSHING, Phase.TOUCHING, Phase.SEATED)
# the hole is seen some millimetres off: the first push presses on the rim
SEEN_OFF: dict[str, Any] = {"vision": {"extra_noise": {"lateral_m": 0.004}}}
MOVING_RAD_S = 0.05
# |F| of contact, N, to wait for before the signal is sent
CONTACT_N = {Phase.PUSHING: 5.0, Phase.TOUCHING: 2.0, Phase.SEATED: 2.0}


class ServiceEnding(str, Enum):
    """How a service is ended."""

    KILL = "SIGKILL"  # killed; the launcher starts it again, as always
    STOP = "SIGSTOP"  # stopped: it hangs, and nobody starts it again

    @property
    def number(self) -> signal.Signals:
        """The signal itself."""
        return signal.Signals[self.value]


class KillCase(BaseModel):
    """One service ended in one phase. `seed` draws the hole."""

    model_config = ConfigDict(frozen=True)

    service: str
    phase: Phase
    ending: ServiceEnding
    seed: int

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.service} {self.ending.value} {self.phase.value}"

    @property
    def strategy(self) -> Strategy:
        """A strategy that reaches that phase: without vision the hole is always touched."""
        return Strategy.FORCE_ALONE if self.phase is Phase.TOUCHING else Strategy.FUSED

    @property
    def overrides(self) -> dict[str, Any]:
        """Overrides of the cell's file."""
        off = SEEN_OFF if self.phase is Phase.PUSHING else {}
        return {**off, "hardware": {"simulated": {"watch_contact": True}}}


def cases(
    services: Iterable[str], phases: Iterable[Phase], endings: Iterable[ServiceEnding], seed: int
) -> Iterator[KillCase]:
    """All of them, in the order of the table."""
    phases, endings = tuple(phases), tuple(endings)
    for service in services:
        for ending in endings:
            for phase in phases:
                yield KillCase(service=service, phase=phase, ending=ending, seed=seed)


def begins(case: KillCase, told: AssemblyPhase) -> bool:
    """Whether this step of the assembly is the one in which the service is to be ended, once it moves or touches."""
    if told.phase is not case.phase:
        return False
    if case.phase is Phase.PUSHING:
        return told.text.startswith("compliant push")
    if case.phase is Phase.TOUCHING:
        return told.text.startswith("touch ")
    if case.phase is Phase.SEATED:
        return told.text.startswith("pressing")
    return True


def ripe(case: KillCase, speed_rad_s: float, force_n: float) -> bool:
    """Whether the moment has come: the arm moves, or presses, as the phase requires."""
    if case.phase is Phase.LOCATING:
        return True
    if case.phase is Phase.APPROACHING:
        return speed_rad_s > MOVING_RAD_S
    return force_n > CONTACT_N[case.phase]
