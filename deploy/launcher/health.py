"""Whether a service is healthy, from its healthcheck or from its own notifications: a pure state, moved by events.

A service with a ``healthcheck`` is healthy when the test passes and unhealthy after ``retries`` failures in a row
(Compose). A service with ``x-notify`` is healthy when it sent ``READY=1``, and stays so as long as ``WATCHDOG=1``
arrives within ``x-watchdog_s``, if that is set (systemd). A service with neither has no health.
"""

from dataclasses import dataclass, replace
from enum import Enum


class Health(str, Enum):
    """What is known of a running service."""

    NONE = "none"  # nothing is watched
    STARTING = "starting"  # not ready yet, and not given up
    HEALTHY = "healthy"
    UNHEALTHY = "unhealthy"  # it runs, but does not answer


@dataclass(frozen=True)
class HealthState:
    """The health of one process; times are monotonic seconds, any origin, the same for all events."""

    health: Health = Health.NONE
    failures_in_row: int = 0
    status: str = ""
    alive_at_s: float | None = None


def after_check(state: HealthState, passed: bool, retries: int, in_start_period: bool) -> HealthState:
    """The state after one healthcheck. Failures in the start period do not count (Compose)."""
    if passed:
        return replace(state, health=Health.HEALTHY, failures_in_row=0)
    if in_start_period and state.health is Health.STARTING:
        return state
    failures = state.failures_in_row + 1
    return replace(state, failures_in_row=failures, health=Health.UNHEALTHY if failures >= retries else state.health)


def after_notification(state: HealthState, message: bytes, now_s: float) -> HealthState:
    """The state after one ``sd_notify`` datagram; assignments that are not known are ignored, as in systemd."""
    for line in message.decode(errors="replace").splitlines():
        name, _, value = line.partition("=")
        if name == "READY" and value == "1":
            state = replace(state, health=Health.HEALTHY, alive_at_s=now_s)
        elif name == "WATCHDOG" and value == "1":
            # Before READY the service is still starting, and a sign of life does not change that.
            revived = Health.HEALTHY if state.health is Health.UNHEALTHY else state.health
            state = replace(state, health=revived, alive_at_s=now_s)
        elif name == "STATUS":
            state = replace(state, status=value)
    return state


def after_silence(state: HealthState, watchdog_s: float, now_s: float) -> HealthState:
    """The state at ``now_s`` if no notification came: unhealthy when the last sign of life is too old."""
    if state.health is Health.HEALTHY and state.alive_at_s is not None and now_s - state.alive_at_s > watchdog_s:
        return replace(state, health=Health.UNHEALTHY)
    return state
