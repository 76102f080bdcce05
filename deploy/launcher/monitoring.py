"""Watching one running process: its healthcheck, its watchdog, and what it is given to report with."""

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path

from deploy.launcher.compose import Healthcheck, Service
from deploy.launcher.health import Health, HealthState, after_check, after_silence
from deploy.launcher.process import passes


def child_environment(service: Service, inherited: Mapping[str, str], notify_path: Path | None) -> dict[str, str]:
    """The whole environment of a service: ours, then what the compose file says, then where to report to.

    A variable that the compose file names without a value is passed on if it is set. The launcher's own
    ``NOTIFY_SOCKET`` is never passed on: the launcher may itself be run by systemd.
    """
    environment = {name: value for name, value in inherited.items() if name not in ("NOTIFY_SOCKET", "WATCHDOG_USEC")}
    # Lines are shown as they are written, not when a buffer is full.
    environment["PYTHONUNBUFFERED"] = "1"
    environment.update({name: value for name, value in service.environment.items() if value is not None})
    if notify_path is not None:
        environment["NOTIFY_SOCKET"] = str(notify_path)
    if service.watchdog_s is not None:
        environment["WATCHDOG_USEC"] = str(round(service.watchdog_s * 1e6))
    return environment


async def after_each_check(
    check: Healthcheck,
    environment: Mapping[str, str],
    working_dir: Path,
    began_s: float,
    current: Callable[[], HealthState],
    update: Callable[[HealthState], None],
) -> None:
    """Run the healthcheck until cancelled: first after one interval, then one interval after each end (Compose)."""
    loop = asyncio.get_running_loop()
    while True:
        starting = loop.time() - began_s < check.start_period and current().health is Health.STARTING
        await asyncio.sleep(check.start_interval if starting else check.interval)
        passed = await passes(check.test, environment, working_dir, check.timeout)
        in_start_period = loop.time() - began_s < check.start_period
        update(after_check(current(), passed, check.retries, in_start_period))


async def watch_for_silence(
    watchdog_s: float, current: Callable[[], HealthState], update: Callable[[HealthState], None]
) -> None:
    """Mark a service unhealthy when it has been silent for ``watchdog_s``, until cancelled."""
    loop = asyncio.get_running_loop()
    while True:
        alive_at_s = current().alive_at_s
        due_s = watchdog_s if alive_at_s is None else alive_at_s + watchdog_s - loop.time()
        # Once it is overdue, look again after a full period; a sign of life has its own effect at once.
        await asyncio.sleep(due_s + 1e-3 if due_s > 0.0 else watchdog_s)
        health = current()
        update(after_silence(health, watchdog_s, loop.time()))
