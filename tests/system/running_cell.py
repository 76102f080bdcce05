"""The whole cell as the launcher runs it, on a router, a state directory and a cell's file of its own."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from crosspih_common.messages import AssemblyPhase
from deploy.launcher import StackRequest, StackState, StateDirectory, is_up, start_stack, stop_stack
from deploy.launcher.health import Health
from deploy.launcher.state import ServiceRow
from services.operator.assembly.session import NEEDED, Session
from tests.deploy.harness import is_alive

ROOT = Path(__file__).resolve().parents[2]
PROJECT = "system-test"
SERVICES = ("router", *NEEDED, "recorder")
DEADLINE_S = 90.0


def wait_until(condition: Callable[[], bool], what: str) -> None:
    """Return as soon as the condition holds; fail the test when it does not within the deadline."""
    pause = threading.Event()
    until = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < until, f"never happened: {what}"
        pause.wait(0.02)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class RunningCell:
    """A stack, and what tests do to it. Points this process's own environment at it."""

    def __init__(self, folder: Path, name: str, environment: pytest.MonkeyPatch, more: str = "") -> None:
        self.folder, self.name = folder, name
        self.recordings = folder / "recordings"
        self.calibration_file = folder / "ft-calibration.yaml"
        self.endpoint = f"tcp/127.0.0.1:{_free_port()}"
        cell_file = folder / "cell.yaml"
        cell_file.write_text(
            f"cell:\n  name: {name}\nrecorder:\n  directory: {self.recordings}\n"
            f"force_torque:\n  calibration_file: {self.calibration_file}\n{more}"
        )
        for variable, value in {
            "CROSSPIH_CELL": str(cell_file),
            "CROSSPIH_ENDPOINT": self.endpoint,
            "CROSSPIH_RUN_DIR": str(folder / "run"),
            "CROSSPIH_PROJECT": PROJECT,
            "CROSSPIH_SPEED": "max",
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "PYTHONPATH": str(ROOT),
        }.items():
            environment.setenv(variable, value)

    def start(self) -> StackState:
        """All services, healthy."""
        return start_stack(StackRequest(project=PROJECT), wait_healthy=True, timeout_s=DEADLINE_S)

    def stop(self) -> None:
        """Everything ends; fails when a process is left."""
        pids = self.pids()
        if is_up(PROJECT):
            stop_stack(PROJECT)
        left = {service: pid for service, pid in pids.items() if is_alive(pid)}
        for pid in left.values():
            os.kill(pid, signal.SIGKILL)
        assert not left, f"still there after the stack was stopped: {left}"

    def state(self) -> StackState:
        """What the launcher last wrote."""
        state = StateDirectory(PROJECT).read()
        assert state is not None
        return state

    def row(self, service: str) -> ServiceRow:
        """One service as the launcher sees it."""
        return next(row for row in self.state().services if row.service == service)

    def pids(self) -> dict[str, int]:
        """Every process of the stack that the launcher knows, its own included."""
        state = StateDirectory(PROJECT).read()
        if state is None:
            return {}
        return {"launcher": state.supervisor_pid} | {row.service: row.pid for row in state.services if row.pid}

    def kill(self, service: str) -> int:
        """kill -9; returns the pid that was."""
        pid = self.row(service).pid
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        return pid

    def wait_restarted(self, service: str, old_pid: int) -> None:
        """Until the launcher has a new process of the service, and it is healthy."""

        def restarted() -> bool:
            row = self.row(service)
            return row.pid not in (None, old_pid) and row.health is Health.HEALTHY

        wait_until(restarted, f"{service} is restarted")

    def session(self) -> Session:
        """An operator's place on the bus, once all services live."""
        opened = Session()
        try:
            opened.wait_for_services(DEADLINE_S, (*NEEDED, "recorder"))
        except BaseException:
            opened.bus.close()
            raise
        return opened

    def cli(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """`crosspih <arguments>` as its own process, as in a narrow pipe."""
        return subprocess.run(
            [sys.executable, "-m", "services.operator", *arguments],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
            timeout=DEADLINE_S,
        )


class KillOnPhase:
    """Kills a service once, when the first accepted step of an assembly is told."""

    def __init__(self, cell: RunningCell, service: str, accept: Callable[[AssemblyPhase], bool]) -> None:
        self._cell, self._service, self._accept = cell, service, accept
        self.killed_pid: int | None = None

    def __call__(self, phase: AssemblyPhase) -> None:
        if self.killed_pid is None and self._accept(phase):
            self.killed_pid = self._cell.kill(self._service)
