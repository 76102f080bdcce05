"""Real stacks of one-line services, and certainty that none of them outlives its test."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import yaml

from deploy.launcher import NotUpError, StackRequest, StackState, StateDirectory, start_stack, stop_stack
from deploy.launcher.state import ServiceRow

ROOT = Path(__file__).resolve().parents[2]
DEADLINE_S = 20.0

NOTIFY = "import os,socket;n=socket.socket(socket.AF_UNIX,socket.SOCK_DGRAM);n.connect(os.environ['NOTIFY_SOCKET']);"
SERVE = [sys.executable, "-S", "-c", "import signal;print('serving');signal.pause()"]


def wait_until(condition: Callable[[], bool], what: str) -> None:
    """Return as soon as ``condition`` holds; fail the test if it does not within the deadline."""
    pause = threading.Event()
    deadline_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline_s, f"never happened: {what}"
        pause.wait(0.02)


def is_alive(pid: int) -> bool:
    """Whether a process runs; a zombie that nobody has reaped yet does not."""
    if Path("/proc/self/stat").exists():  # Linux, where a small system may have no ps.
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].strip()
        except (FileNotFoundError, ProcessLookupError):
            return False
    else:
        shown = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True, check=False)
        state = shown.stdout.strip()
    return bool(state) and not state.startswith("Z")


class Stacks:
    """Makes compose files and runs them, each project with its state under one temporary folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.run_root = folder / "run"
        self.foreground: list[subprocess.Popen[str]] = []

    def compose(self, services: dict[str, object], name: str = "compose.yaml") -> Path:
        path = self.folder / name
        path.write_text(yaml.safe_dump({"services": services}))
        return path

    def request(self, services: dict[str, object], project: str = "test") -> StackRequest:
        return StackRequest(project, self.compose(services, f"{project}.yaml"), run_root=self.run_root)

    def start(self, services: dict[str, object], project: str = "test", wait_healthy: bool = True) -> StackState:
        return start_stack(self.request(services, project), wait_healthy=wait_healthy, timeout_s=DEADLINE_S)

    def directory(self, project: str = "test") -> StateDirectory:
        return StateDirectory(project, self.run_root)

    def row(self, service: str, project: str = "test") -> ServiceRow:
        state = self.directory(project).read()
        assert state is not None
        return next(row for row in state.services if row.service == service)

    def log(self, service: str, project: str = "test") -> list[str]:
        return [line.text for line in self.directory(project).tails((service,))[service].read()]

    def pid_written_by(self, service: str, project: str = "test") -> int:
        """The number that a service printed as its first line, such as the pid of a child it made."""
        wait_until(lambda: bool(self.log(service, project)), f"{service} prints a pid")
        return int(self.log(service, project)[0])

    def environment(self) -> dict[str, str]:
        ours = {"CROSSPIH_RUN_DIR": str(self.run_root), "CROSSPIH_PROJECT": "test", "COLUMNS": "120", "TERM": "dumb"}
        return {**os.environ, "PYTHONPATH": str(ROOT), **ours}

    def cli(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [sys.executable, "-m", "deploy.launcher.cli", *arguments],
            env=self.environment(),
            capture_output=True,
            text=True,
            check=False,
            timeout=60.0,
        )

    def cli_in_foreground(self, *arguments: str) -> "subprocess.Popen[str]":
        """As a terminal runs it: a process group of its own, which Ctrl-C reaches as a whole."""
        process = subprocess.Popen(
            [sys.executable, "-m", "deploy.launcher.cli", *arguments],
            env=self.environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self.foreground.append(process)
        return process

    def close(self) -> None:
        for process in self.foreground:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            if process.stdout is not None:
                process.stdout.close()
            process.wait()
        for path in self.run_root.glob("*"):
            with contextlib.suppress(NotUpError):
                stop_stack(path.name, self.run_root)
