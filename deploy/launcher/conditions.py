"""What is known of each service of a running stack, and whether that is what another waits for. Pure."""

from dataclasses import dataclass, field
from enum import Enum

from deploy.launcher.health import Health, HealthState


class StartCondition(str, Enum):
    """What a service waits for in another before it starts."""

    STARTED = "service_started"
    HEALTHY = "service_healthy"
    COMPLETED = "service_completed_successfully"


class ServicePhase(str, Enum):
    """Where a service is in its life under the launcher."""

    WAITING = "waiting"  # for a dependency
    RUNNING = "running"
    RESTARTING = "restarting"  # it ended and starts again after the back-off
    EXITED = "exited"  # it ended and its policy leaves it down
    BLOCKED = "blocked"  # a dependency will never be what it needs; it was not started
    STOPPED = "stopped"  # ended by the launcher


@dataclass(frozen=True)
class ServiceStanding:
    """A service at one instant; ``exit_code`` is that of its last process (negative: by that signal)."""

    phase: ServicePhase = ServicePhase.WAITING
    health: HealthState = field(default_factory=HealthState)
    pid: int | None = None
    exit_code: int | None = None
    restarts: int = 0
    note: str = ""


class DependencyVerdict(str, Enum):
    """Whether a dependency is what its dependant waits for."""

    MET = "met"
    PENDING = "pending"
    NEVER = "never"


def judge(condition: StartCondition, standing: ServiceStanding) -> DependencyVerdict:
    """Whether ``standing`` meets ``condition``, may still come to, or never will.

    A service that restarts, or is unhealthy for now, may still come to be healthy.
    """
    phase = standing.phase
    if phase in (ServicePhase.BLOCKED, ServicePhase.STOPPED):
        return DependencyVerdict.NEVER
    if condition is StartCondition.STARTED:
        return DependencyVerdict.PENDING if phase is ServicePhase.WAITING else DependencyVerdict.MET
    if condition is StartCondition.HEALTHY:
        if phase is ServicePhase.EXITED:
            return DependencyVerdict.NEVER
        healthy = phase is ServicePhase.RUNNING and standing.health.health is Health.HEALTHY
        return DependencyVerdict.MET if healthy else DependencyVerdict.PENDING
    if phase is ServicePhase.EXITED:
        return DependencyVerdict.MET if standing.exit_code == 0 else DependencyVerdict.NEVER
    return DependencyVerdict.PENDING


def describe_exit(exit_code: int) -> str:
    """An exit code in words: ``exit 1``, or ``signal 9``."""
    return f"signal {-exit_code}" if exit_code < 0 else f"exit {exit_code}"
