"""The state directory of a project, ``run/<project>/``: who supervises it, how its services are, what they wrote.

lock             held (flock) by the supervisor as long as it lives, so that a dead one is never taken for alive
state.json       StackState, replaced as a whole at every change
<service>.log    see logfile.py
stopped.json     StoppedStack, of the stack that was stopped last
supervisor.log   what a detached supervisor itself said
"""

import contextlib
import fcntl
import json
import os
import re
import shutil
import time
from pathlib import Path
from typing import IO

from pydantic import BaseModel, ConfigDict, ValidationError

from crosspih_common.modules import RUN_DIR_VARIABLE, run_folder
from deploy.launcher.conditions import ServicePhase
from deploy.launcher.errors import AlreadyUpError, LauncherError
from deploy.launcher.health import Health
from deploy.launcher.logfile import SUFFIX, LogTail

DEFAULT_PROJECT = "crosspih"
_PROJECT_NAME = re.compile(r"[a-zA-Z0-9][a-zA-Z0-9._-]*")
_STOPPED = "stopped.json"
_SUPERVISOR_LOG = "supervisor.log"


class ServiceRow(BaseModel):
    """One row of ``crosspih ps``. ``exit_code`` is that of the last process that ended (negative: by that signal)."""

    model_config = ConfigDict(frozen=True)

    service: str
    phase: ServicePhase
    health: Health
    pid: int | None
    exit_code: int | None
    restarts: int
    since: str
    note: str


class StackState(BaseModel):
    """What the supervisor last wrote; ``finished`` once all its services ended by themselves and it ended too."""

    model_config = ConfigDict(frozen=True)

    project: str
    compose_file: str
    supervisor_pid: int
    since: str
    finished: bool
    services: tuple[ServiceRow, ...]


def default_run_root() -> Path:
    """Where stacks keep their state and logs: crosspih_common.modules.run_folder."""
    return run_folder()


class Stopped(BaseModel):
    """How one service ended when its stack was stopped: in order, or killed as it had not ended in its time."""

    model_config = ConfigDict(frozen=True)

    service: str
    killed: bool
    seconds: float


class StoppedStack(BaseModel):
    """What a supervisor leaves of the stack that it stopped."""

    model_config = ConfigDict(frozen=True)

    supervisor_pid: int
    services: tuple[Stopped, ...] = ()


def _locked(fd: int) -> bool:
    """Take the lock; tried for a moment, since another process may hold it shared while it looks (is_supervised)."""
    for _ in range(10):
        with contextlib.suppress(OSError):
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        time.sleep(0.01)
    return False


class StateDirectory:
    """The state directory of one project; made by the supervisor, read by everyone else."""

    def __init__(self, project: str = DEFAULT_PROJECT, run_root: Path | None = None) -> None:
        if not _PROJECT_NAME.fullmatch(project):
            raise LauncherError(f"{project!r} is not a project name; use letters, digits, '.', '_' and '-'")
        self.project = project
        self.path = (run_root if run_root is not None else default_run_root()) / project
        self.supervisor_log = self.path / _SUPERVISOR_LOG
        self._lock_fd: int | None = None

    @property
    def notify_path(self) -> Path:
        """Where the notify sockets lie."""
        return self.path / "notify"

    def make(self) -> None:
        """Make the folder. Raises LauncherError, which says what to do where that cannot be."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._unusable(error) from None

    def _unusable(self, error: OSError) -> LauncherError:
        return LauncherError(
            f"{self.path}: no state and no logs can be kept there ({error.strerror}); name a folder of yours with "
            f"{RUN_DIR_VARIABLE}"
        )

    def acquire(self) -> None:
        """Become the supervisor of this project; raises AlreadyUpError, LauncherError.

        What a dead one left behind is removed, and the logs of the last stack are set aside as ``<service>.log.1``.
        """
        self.make()
        try:
            fd = os.open(self.path / "lock", os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise self._unusable(error) from None
        if not _locked(fd):
            os.close(fd)
            raise AlreadyUpError(
                f"project {self.project!r} is up already; take it down first (crosspih down), "
                "or give this one another --project"
            )
        self._lock_fd = fd
        self._remove_state()
        (self.path / _STOPPED).unlink(missing_ok=True)
        for path in self.path.glob(f"*{SUFFIX}"):
            if path != self.supervisor_log:
                path.replace(path.with_name(path.name + ".1"))

    def open_supervisor_log(self) -> IO[bytes]:
        """The log of a detached supervisor, from its beginning. Raises LauncherError where it cannot be written."""
        try:
            return self.supervisor_log.open("wb")
        except OSError as error:
            raise self._unusable(error) from None

    def release(self, keep_state: bool) -> None:
        """End being the supervisor; the state is kept only if there is something left to show."""
        if not keep_state:
            self._remove_state()
        if self._lock_fd is not None:
            os.close(self._lock_fd)
            self._lock_fd = None

    def is_supervised(self) -> bool:
        """Whether a supervisor of this project lives."""
        try:
            fd = os.open(self.path / "lock", os.O_RDONLY)
        except (FileNotFoundError, NotADirectoryError):
            return False
        except PermissionError as error:
            raise self._unusable(error) from None
        try:
            fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
        finally:
            os.close(fd)
        return False

    def write(self, state: StackState) -> None:
        """Replace the state as a whole."""
        target = self.path / "state.json"
        scratch = target.with_suffix(".new")
        scratch.write_text(state.model_dump_json(indent=1), encoding="utf-8")
        scratch.replace(target)

    def write_stopped(self, stopped: StoppedStack) -> None:
        """What became of each service; stays until the next stack."""
        (self.path / _STOPPED).write_text(stopped.model_dump_json(indent=1), encoding="utf-8")

    def read_stopped(self, supervisor_pid: int) -> tuple[Stopped, ...]:
        """What that supervisor left of its stack; nothing where it was killed itself."""
        try:
            found = StoppedStack.model_validate_json((self.path / _STOPPED).read_text(encoding="utf-8"))
        except (OSError, ValidationError):
            return ()
        return found.services if found.supervisor_pid == supervisor_pid else ()

    def read(self) -> StackState | None:
        """The last state written, or None if there is none that can be read."""
        try:
            return StackState.model_validate(json.loads((self.path / "state.json").read_text(encoding="utf-8")))
        except (FileNotFoundError, NotADirectoryError, ValidationError, json.JSONDecodeError):
            return None

    def clean_if_stale(self) -> int | None:
        """Remove the state of a supervisor that died without cleaning up; returns its process identifier."""
        state = self.read()
        if state is None or state.finished or self.is_supervised():
            return None
        # It may have ended in order between the two looks; then there is no state any more.
        if self.read() is None:
            return None
        self._remove_state()
        return state.supervisor_pid

    def tails(self, services: tuple[str, ...] = ()) -> dict[str, LogTail]:
        """A reader for each service's log file that exists, or for those named."""
        names = services or tuple(
            sorted(path.name[: -len(SUFFIX)] for path in self.path.glob(f"*{SUFFIX}") if path != self.supervisor_log)
        )
        return {name: LogTail(self.log_path(name)) for name in names}

    def log_path(self, service: str) -> Path:
        """The log file of one service."""
        return self.path / f"{service}{SUFFIX}"

    def _remove_state(self) -> None:
        with contextlib.suppress(FileNotFoundError):
            (self.path / "state.json").unlink()
        shutil.rmtree(self.notify_path, ignore_errors=True)
