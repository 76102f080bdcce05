"""The trials on one host, in plain TCP, and on three with mTLS."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from services.operator.bench.reliability.hosts.stacks import COMPUTE, ONE, THREE, Host

PATIENT_S = 0.5  # `hardware.limits.holder_timeout_s` for a link that loses packets
DELAY_S, LOSS, CUT_S, AHEAD_S = 0.05, 0.01, 5.0, 0.1
CUT_AT, CUT_AFTER_S = "pushing", 2.0  # in the middle of a motion


@dataclass(frozen=True)
class Trial:
    """One assembly. `cut_s`: the cable of the planner's host is out for this time, from CUT_AFTER_S after the step
    CUT_AT; the assembly after it, with the cable in, is a separate trial.
    """

    name: str
    hosts: Sequence[Host]
    holder_timeout_s: float | None = None  # None: the cell's own setting
    delay_s: float = 0.0
    loss: float = 0.0
    cut_s: float = 0.0

    def same_stack(self, other: Trial | None) -> bool:
        """Whether both can be made on one stack."""
        return other is not None and (self.hosts, self.holder_timeout_s) == (other.hosts, other.holder_timeout_s)


def _ahead() -> tuple[Host, ...]:
    return tuple(replace(host, clock_ahead_s=AHEAD_S) if host is COMPUTE else host for host in THREE)


AHEAD = _ahead()
BAD = {"delay_s": DELAY_S, "loss": LOSS}
TRIALS: dict[str, Trial] = {
    trial.name: trial
    for trial in (
        Trial("one host", ONE),
        Trial("three hosts", THREE),
        Trial("50 ms, 1 % lost", THREE, delay_s=DELAY_S, loss=LOSS),
        Trial("cut for 5 s", THREE, cut_s=CUT_S),
        Trial("after the cut", THREE),
        Trial("clocks 100 ms apart", AHEAD, PATIENT_S),
        Trial("50 ms, 1 % lost, patient", AHEAD, PATIENT_S, delay_s=DELAY_S, loss=LOSS),
    )
}


@dataclass
class Chosen:
    """The trials to make, grouped by stack."""

    trials: list[Trial] = field(default_factory=list)

    def stacks(self) -> list[list[Trial]]:
        """Trials that follow each other on one stack."""
        found: list[list[Trial]] = []
        for trial in self.trials:
            if found and trial.same_stack(found[-1][-1]):
                found[-1].append(trial)
            else:
                found.append([trial])
        return found
