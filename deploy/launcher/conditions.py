"""What is known of each service of a running stack, and whether that is what another waits for. Pure."""

from dataclasses import dataclass, field
from enum import Enum

from deploy.launcher.health import Health, HealthState


class Condition(str, Enum):
    """What a service waits for in another before it starts."""

    STARTED = "service_started"
    HEALTHY = "service_healthy"
    COMPLETED = "service_completed_successfully"


class Phase(str, Enum):
    """Where a service is in its life under the launcher."""

    WAITING = "waiting"  # for a dependency
    RUNNING = "running"
    RESTARTING = "restarting"  # it ended and starts again after the back-off
    EXITED = "exited"  # it ended and its policy leaves it down
    BLOCKED = "blocked"  # a dependency will never be what it needs; it was not started
    STOPPED = "stopped"  # ended by the launcher


@dataclass(frozen=True)
class Standing:
    """A service at one instant; ``exit_code`` is that of its last process (negative: by that signal)."""

    phase: Phase = Phase.WAITING
    health: HealthState = field(default_factory=HealthState)
    pid: int | None = None
    exit_code: int | None = None
    restarts: int = 0
    note: str = ""


class Verdict(str, Enum):
    """Whether a dependency is what its dependant waits for."""

    MET = "met"
    PENDING = "pending"
    NEVER = "never"


def judge(condition: Condition, standing: Standing) -> Verdict:
    """Whether ``standing`` meets ``condition``, may still come to, or never will.

    A service that restarts, or is unhealthy for now, may still come to be healthy.
    """
    phase = standing.phase
    if phase in (Phase.BLOCKED, Phase.STOPPED):
        return Verdict.NEVER
    if condition is Condition.STARTED:
        return Verdict.PENDING if phase is Phase.WAITING else Verdict.MET
    if condition is Condition.HEALTHY:
        if phase is Phase.EXITED:
            return Verdict.NEVER
        healthy = phase is Phase.RUNNING and standing.health.health is Health.HEALTHY
        return Verdict.MET if healthy else Verdict.PENDING
    if phase is Phase.EXITED:
        return Verdict.MET if standing.exit_code == 0 else Verdict.NEVER
    return Verdict.PENDING


def describe_exit(exit_code: int) -> str:
    """An exit code in words: ``exit 1``, or ``signal 9``."""
    return f"signal {-exit_code}" if exit_code < 0 else f"exit {exit_code}"
