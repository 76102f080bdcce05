"""Runs a stack: starts services when what they wait for is there, restarts them by policy, stops them in order."""

import asyncio
import contextlib
import os
import signal
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from crosspih_common.errors import CONFIG_STATUS
from deploy.launcher.compose import Service
from deploy.launcher.conditions import DependencyVerdict, ServicePhase, ServiceStanding, describe_exit, judge
from deploy.launcher.health import Health, HealthState, after_notification
from deploy.launcher.logfile import LogLine, LogWriter, timestamp
from deploy.launcher.monitoring import after_each_check, child_environment, watch_for_silence
from deploy.launcher.notify_socket import NotifyFolder, NotifySocket
from deploy.launcher.order import start_levels
from deploy.launcher.process import Guard, ServiceProcess
from deploy.launcher.restart import decide
from deploy.launcher.state import ServiceRow, StackState, StateDirectory, Stopped, StoppedStack
from deploy.launcher.state_keeper import StateKeeper

# Ctrl-C has to stop everything within 3 s; this leaves room for the kill and the clearing up.
STOP_TIMEOUT_S = 2.3
SUPERVISOR = "launcher"  # whose lines these are in the log


class _Unit:
    """What the supervisor holds of one service."""

    def __init__(self, name: str, service: Service, working_dir: Path, log: LogWriter) -> None:
        self.name = name
        self.service = service
        self.working_dir = working_dir
        self.log = log
        self.standing = ServiceStanding()
        self.since = timestamp()
        self.process: ServiceProcess | None = None
        self.notify: NotifySocket | None = None
        self.down = asyncio.Event()  # it has no process and gets none any more


class Supervisor:
    """Runs ``services`` as the supervisor of ``directory``'s project; ``show`` gets every line as it comes.

    ``compose_file`` gives the folder that ``working_dir`` is relative to. Make it within a running event loop, and
    after ``directory.acquire()``.
    """

    def __init__(
        self,
        services: Mapping[str, Service],
        compose_file: Path,
        directory: StateDirectory,
        show: Callable[[LogLine], None],
        stop_timeout_s: float = STOP_TIMEOUT_S,
        whole: bool = False,
    ) -> None:
        self._directory = directory
        self._compose_file = compose_file.resolve()
        self._show = show
        self._state = StateKeeper(directory, self._say_of_all)
        self._stop_timeout_s = stop_timeout_s
        self._whole, self._hopeless = whole, False
        self._levels = start_levels(services)
        self._stopping = asyncio.Event()
        self._killing = asyncio.Event()
        self._changed = asyncio.Event()
        self._since = timestamp()
        self._guard = Guard()
        self._stopped: list[Stopped] = []
        self._notify_folder = NotifyFolder(directory.notify_path)
        self._units = {
            name: _Unit(
                name, service, self._compose_file.parent / service.working_dir, LogWriter(directory.log_path(name))
            )
            for name, service in services.items()
        }

    def stop(self) -> None:
        """Stop all services in order; called once more, kill them."""
        (self._killing if self._stopping.is_set() else self._stopping).set()
        self._announce()

    async def run(self) -> int:
        """Run until :meth:`stop`, or until every service ended for good.

        Returns 0 if it was stopped, or if every service ended with exit status 0, and 1 otherwise. With ``whole`` a
        service that says by CONFIG_STATUS that it cannot read its settings ends it too.
        """
        self._announce()
        lives = [asyncio.create_task(self._live(unit)) for unit in self._units.values()]
        stopped = asyncio.create_task(self._stopping.wait())
        everything = asyncio.gather(*lives)
        watched: list[asyncio.Future[Any]] = [everything, stopped]
        try:
            await asyncio.wait(watched, return_when=asyncio.FIRST_COMPLETED)
            if self._stopping.is_set():
                await self._stop_in_order()
            await everything
        finally:
            self._clear_up()
            stopped.cancel()
        if self._stopping.is_set():
            return 1 if self._hopeless else 0
        self._write_state(finished=True)
        return 0 if all(unit.standing.exit_code == 0 for unit in self._units.values()) else 1

    # The life of one service.

    async def _live(self, unit: _Unit) -> None:
        try:
            if not await self._dependencies_met(unit):
                return
            attempt = 0
            while not self._stopping.is_set():
                exit_code, ran_s = await self._run_once(unit)
                unit.standing = replace(
                    unit.standing,
                    pid=None,
                    exit_code=exit_code,
                    health=HealthState(),
                    phase=ServicePhase.STOPPED,
                    note="",
                )
                if self._stopping.is_set():
                    break
                decision = decide(unit.service.restart, exit_code, ran_s, attempt)
                if decision is None:
                    self._say(unit, f"ended ({describe_exit(exit_code)})")
                    self._enter(unit, ServicePhase.EXITED)
                    if self._whole and exit_code == CONFIG_STATUS:
                        self._hopeless = True
                        self._say(unit, "cannot start with these settings: the stack is stopped")
                        self._stopping.set()
                        self._announce()
                    return
                attempt = decision.attempt
                self._say(unit, f"ended ({describe_exit(exit_code)}); starts again in {decision.delay_s:.1f} s")
                unit.standing = replace(unit.standing, restarts=unit.standing.restarts + 1)
                self._enter(unit, ServicePhase.RESTARTING)
                await self._pause(decision.delay_s)
            self._enter(unit, ServicePhase.STOPPED)
        finally:
            unit.down.set()

    async def _dependencies_met(self, unit: _Unit) -> bool:
        while True:
            changed = self._changed
            if self._stopping.is_set():
                self._enter(unit, ServicePhase.STOPPED)
                return False
            pending: list[str] = []
            for needed, dependency in unit.service.depends_on.items():
                if needed not in self._units:
                    continue  # Not required, and not among the services run.
                standing = self._units[needed].standing
                verdict = judge(dependency.condition, standing)
                if verdict is DependencyVerdict.NEVER and dependency.required:
                    ended = f" ({describe_exit(standing.exit_code)})" if standing.exit_code is not None else ""
                    problem = f"{needed} is {standing.phase.value}{ended}, not {dependency.condition.value}"
                    self._say(unit, f"not started: {problem}")
                    self._enter(unit, ServicePhase.BLOCKED, note=problem)
                    return False
                if verdict is DependencyVerdict.PENDING:
                    pending.append(f"{needed}: {dependency.condition.value}")
            if not pending:
                return True
            note = "for " + ", ".join(pending)
            if unit.standing.note != note:
                self._enter(unit, ServicePhase.WAITING, note=note)
            await changed.wait()

    async def _run_once(self, unit: _Unit) -> tuple[int, float]:
        """Run one process to its end; returns its exit code and how long it ran in seconds."""
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        service = unit.service
        if service.notify:
            try:
                self._listen(unit).drain()
            except OSError as error:
                self._say(unit, f"cannot start: {error.strerror or error} ({self._notify_folder.path})")
                return 127, 0.0
        environment = child_environment(service, os.environ, unit.notify.path if unit.notify else None)
        try:
            process = await ServiceProcess.start(
                service.command, environment, unit.working_dir, lambda text: self._log(unit, text)
            )
        except OSError as error:
            self._say(unit, f"cannot start: {error.strerror or error} ({error.filename or service.command[0]})")
            return 127, 0.0
        self._guard.watch(process.pid)
        unit.process = process
        health = Health.STARTING if service.has_health else Health.NONE
        unit.standing = replace(unit.standing, pid=process.pid, health=HealthState(health))
        self._enter(unit, ServicePhase.RUNNING)
        if self._stopping.is_set():
            process.signal_group(signal.SIGTERM)  # The stop came while it was being made.
        monitors = self._monitors(unit, environment, began_s)
        try:
            exit_code = await process.wait()
        finally:
            for monitor in monitors:
                monitor.cancel()
            await asyncio.gather(*monitors, return_exceptions=True)
            unit.process = None
            self._guard.release(process.pid)
        return exit_code, loop.time() - began_s

    def _listen(self, unit: _Unit) -> NotifySocket:
        if unit.notify is None:
            path = self._notify_folder.path / f"{unit.name}.sock"
            unit.notify = NotifySocket(path, lambda message: self._notified(unit, message))
        return unit.notify

    def _monitors(self, unit: _Unit, environment: Mapping[str, str], began_s: float) -> "list[asyncio.Task[None]]":
        def current() -> HealthState:
            return unit.standing.health

        def update(health: HealthState) -> None:
            self._set_health(unit, health)

        monitors = []
        check = unit.service.check
        if check is not None:
            monitors.append(after_each_check(check, environment, unit.working_dir, began_s, current, update))
        if unit.service.watchdog_s is not None:
            monitors.append(watch_for_silence(unit.service.watchdog_s, current, update))
        return [asyncio.create_task(monitor) for monitor in monitors]

    def _notified(self, unit: _Unit, message: bytes) -> None:
        if unit.standing.phase is ServicePhase.RUNNING:
            self._set_health(unit, after_notification(unit.standing.health, message, asyncio.get_running_loop().time()))

    def _set_health(self, unit: _Unit, health: HealthState) -> None:
        before = unit.standing.health
        unit.standing = replace(unit.standing, health=health, note=health.status)
        if health.health is not before.health:
            self._say(unit, f"is {health.health.value}")
        if (health.health, health.status) != (before.health, before.status):
            self._announce()

    # Stopping.

    async def _stop_in_order(self) -> None:
        """Ask dependants to end before what they depend on; kill what has not ended in its time, or in all."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + self._stop_timeout_s
        share_s = self._stop_timeout_s / (len(self._levels) + 1)
        ends = []
        for level in reversed(self._levels):
            units = [self._units[name] for name in level]
            ends += [asyncio.create_task(self._end(unit, deadline_s)) for unit in units]
            # A level that hangs must not use up the time of those below it, so they are asked all the same.
            await asyncio.wait([asyncio.create_task(unit.down.wait()) for unit in units], timeout=share_s)
        await asyncio.gather(*ends)
        with contextlib.suppress(OSError):  # a full disk must not keep it from ending
            self._directory.write_stopped(StoppedStack(supervisor_pid=os.getpid(), services=tuple(self._stopped)))

    async def _end(self, unit: _Unit, deadline_s: float) -> None:
        began_s, ran, killed = asyncio.get_running_loop().time(), unit.process is not None, False
        if unit.process is not None:
            unit.process.signal_group(signal.SIGTERM)
        left_s = deadline_s - asyncio.get_running_loop().time()
        grace_s = max(0.0, min(unit.service.stop_grace_period, left_s))
        waits = [asyncio.create_task(unit.down.wait()), asyncio.create_task(self._killing.wait())]
        await asyncio.wait(waits, timeout=grace_s, return_when=asyncio.FIRST_COMPLETED)
        for wait in waits:
            wait.cancel()
        if not unit.down.is_set():
            if unit.process is not None:
                self._say(unit, "did not end in time; killed")
                unit.process.signal_group(signal.SIGKILL)
                killed = True
            await unit.down.wait()
        if ran:
            seconds = round(asyncio.get_running_loop().time() - began_s, 2)
            self._stopped.append(Stopped(service=unit.name, killed=killed, seconds=seconds))

    def _clear_up(self) -> None:
        for unit in self._units.values():
            if unit.process is not None:
                unit.process.signal_group(signal.SIGKILL)
            if unit.notify is not None:
                unit.notify.close()
            unit.log.close()
        self._state.close()
        self._notify_folder.remove()
        self._guard.close()

    async def _pause(self, delay_s: float) -> None:
        stopping = asyncio.create_task(self._stopping.wait())
        await asyncio.wait({stopping}, timeout=delay_s)
        stopping.cancel()

    # What is known and said.

    def _enter(self, unit: _Unit, phase: ServicePhase, note: str = "") -> None:
        unit.standing = replace(unit.standing, phase=phase, note=note)
        unit.since = timestamp()
        self._announce()

    def _announce(self) -> None:
        self._write_state(finished=False)
        self._changed.set()
        self._changed = asyncio.Event()

    def _write_state(self, finished: bool) -> None:
        self._state.keep(
            StackState(
                project=self._directory.project,
                compose_file=str(self._compose_file),
                supervisor_pid=os.getpid(),
                since=self._since,
                finished=finished,
                services=tuple(
                    ServiceRow(
                        service=unit.name,
                        phase=unit.standing.phase,
                        health=unit.standing.health.health,
                        pid=unit.standing.pid,
                        exit_code=unit.standing.exit_code,
                        restarts=unit.standing.restarts,
                        since=unit.since,
                        note=unit.standing.note,
                    )
                    for unit in self._units.values()
                ),
            )
        )

    def _log(self, unit: _Unit, text: str) -> None:
        line = LogLine(unit.name, timestamp(), text)
        # A full disk or a closed terminal must not end the stack; each line is lost there only.
        with contextlib.suppress(OSError):
            unit.log.write(line)
        self._shown(line)

    def _shown(self, line: LogLine) -> None:
        with contextlib.suppress(OSError):
            self._show(line)

    def _say_of_all(self, text: str) -> None:
        self._shown(LogLine(SUPERVISOR, timestamp(), text))

    def _say(self, unit: _Unit, text: str) -> None:
        self._log(unit, f"[{SUPERVISOR}] {unit.name} {text}")
