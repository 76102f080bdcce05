"""A stack from the outside: start one in the background, wait for it, look at it, take it down.

state = start_stack(StackRequest(project="trial"), wait_healthy=True)
...
stop_stack("trial")
"""

import atexit
import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import deploy
from crosspih_common.errors import CONFIG_STATUS
from crosspih_common.modules import DATA_VARIABLE, data_folder, module_command
from deploy.launcher.compose import Service
from deploy.launcher.conditions import ServicePhase
from deploy.launcher.errors import AlreadyUpError, NotUpError, StartError
from deploy.launcher.health import Health
from deploy.launcher.loading import load_compose
from deploy.launcher.order import select
from deploy.launcher.state import DEFAULT_PROJECT, StackState, StateDirectory, Stopped
from deploy.launcher.supervisor import STOP_TIMEOUT_S

DEFAULT_COMPOSE_FILE = Path(deploy.__file__).resolve().parent / "compose.yaml"
_POLL_S = 0.03
# A service that has to be restarted this often while the stack comes up will not come up.
_HOPELESS_RESTARTS = 3

# The supervisors that this process started, by process identifier. They outlive it; until then they are its children,
# and one that ended stays a zombie unless it is waited for.
_children: "dict[int, subprocess.Popen[bytes]]" = {}


def variables() -> dict[str, str]:
    """What a compose file may ask for: this process's environment, the data folder, and the cell's file by a path that
    holds in any folder."""
    given = {**os.environ, DATA_VARIABLE: str(data_folder())}
    if cell := given.get("CROSSPIH_CELL"):
        given["CROSSPIH_CELL"] = os.path.abspath(cell)
    return given


@dataclass(frozen=True)
class StackRequest:
    """Which stack to run: the project's name, the compose file, and which of its services (none named: all)."""

    project: str = DEFAULT_PROJECT
    compose_file: Path = DEFAULT_COMPOSE_FILE
    services: tuple[str, ...] = ()
    profiles: tuple[str, ...] = ()
    run_root: Path | None = None
    stop_timeout_s: float = STOP_TIMEOUT_S

    def directory(self) -> StateDirectory:
        """The state directory of the project."""
        return StateDirectory(self.project, self.run_root)

    def chosen(self) -> dict[str, Service]:
        """The services to run, with the variables of this process; raises ComposeError."""
        return select(load_compose(self.compose_file, variables()).services, self.services, self.profiles)

    def with_what_comes_by_itself(self) -> "StackRequest":
        """The same with the profiles of services that are there because what they need is installed.

        Unchanged where services are named. Raises ComposeError.
        """
        if self.services:
            return self
        services = load_compose(self.compose_file, variables()).services.values()
        more = {profile for service in services if service.comes_by_itself for profile in service.profiles}
        return replace(self, profiles=tuple(dict.fromkeys((*self.profiles, *sorted(more)))))

    def to_json(self) -> str:
        """For the supervisor's command line."""
        values = asdict(self)
        values["compose_file"] = str(self.compose_file.resolve())
        values["run_root"] = str(self.run_root.resolve()) if self.run_root else None
        return json.dumps(values)

    @classmethod
    def from_json(cls, text: str) -> "StackRequest":
        """The inverse of :meth:`to_json`."""
        values = json.loads(text)
        return cls(
            project=values["project"],
            compose_file=Path(values["compose_file"]),
            services=tuple(values["services"]),
            profiles=tuple(values["profiles"]),
            run_root=Path(values["run_root"]) if values["run_root"] else None,
            stop_timeout_s=values["stop_timeout_s"],
        )


@dataclass
class _Progress:
    """Waiting for the stack; ``reported`` keeps what was told, so that each change is told once."""

    deadline_s: float
    on_change: Callable[[str], None]
    reported: dict[str, str] = field(default_factory=dict)

    def report(self, state: StackState) -> None:
        for row in state.services:
            now = (
                row.health.value
                if row.phase is ServicePhase.RUNNING and row.health is not Health.NONE
                else row.phase.value
            )
            if self.reported.get(row.service) != now:
                self.reported[row.service] = now
                self.on_change(f"{row.service}: {now}")


def start_stack(
    request: StackRequest,
    wait_healthy: bool = True,
    timeout_s: float = 60.0,
    on_change: Callable[[str], None] = lambda _text: None,
) -> StackState:
    """Start a stack in the background and return its state once all its services run.

    With ``wait_healthy`` once all that have a health are healthy. Services that end with exit status 0 count as done.
    ``on_change`` gets a line for each service that comes a step further. The stack gets this process's environment.
    Raises ComposeError, AlreadyUpError, and StartError if a service ends otherwise, is restarted again and again, or
    ``timeout_s`` passes; the stack is down again then.
    """
    _reap()
    request.chosen()
    directory = request.directory()
    if directory.is_supervised():
        raise AlreadyUpError(
            f"project {request.project!r} is up already; take it down first (crosspih down), "
            "or give this one another --project"
        )
    directory.clean_if_stale()
    directory.make()
    with directory.open_supervisor_log() as log:
        supervisor = subprocess.Popen(
            module_command("deploy.launcher", request.to_json()),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    _children[supervisor.pid] = supervisor
    progress = _Progress(time.monotonic() + timeout_s, on_change)
    try:
        return _wait_until_up(supervisor, directory, wait_healthy, progress)
    except BaseException:
        # An interrupted or failed start leaves nothing behind.
        supervisor.terminate()
        supervisor.wait()
        del _children[supervisor.pid]
        raise


def _wait_until_up(
    supervisor: "subprocess.Popen[bytes]", directory: StateDirectory, wait_healthy: bool, progress: _Progress
) -> StackState:
    while True:
        ended = supervisor.poll() is not None
        state = directory.read()
        if state is not None and state.supervisor_pid == supervisor.pid:
            progress.report(state)
            _refuse_failed(state, directory)
            if all(_is_up(row.phase, row.health, wait_healthy) for row in state.services):
                return state
        if ended:
            said = directory.supervisor_log.read_text(errors="replace").strip()
            raise StartError(f"the supervisor ended: {said or f'exit {supervisor.returncode}'}")
        if time.monotonic() > progress.deadline_s:
            raise StartError("not up in time: " + ", ".join(f"{k} {v}" for k, v in sorted(progress.reported.items())))
        time.sleep(_POLL_S)


def _is_up(phase: ServicePhase, health: Health, wait_healthy: bool) -> bool:
    if phase is ServicePhase.EXITED:
        return True
    return phase is ServicePhase.RUNNING and (not wait_healthy or health in (Health.NONE, Health.HEALTHY))


def _refuse_failed(state: StackState, directory: StateDirectory) -> None:
    for row in state.services:
        gave_up = row.phase is ServicePhase.EXITED and row.exit_code
        if gave_up or (row.phase is ServicePhase.RESTARTING and row.restarts >= _HOPELESS_RESTARTS):
            lines = [line.text for line in directory.tails((row.service,))[row.service].read()]
            own = [line for line in lines if line.strip() and not line.startswith("[")]  # the launcher's: [launcher]
            if row.exit_code == CONFIG_STATUS and own:
                raise StartError(f"{row.service} did not start: {_without_level(own[-1])}")
            said = "\n  ".join(lines[-12:])
            raise StartError(f"{row.service} did not start; it wrote:\n  {said}")
    blocked = [f"{row.service}: {row.note}" for row in state.services if row.phase is ServicePhase.BLOCKED]
    if blocked:
        raise StartError("not started: " + "; ".join(blocked))


def _without_level(line: str) -> str:
    """A service's line for people, without how loud it is: `error: failed: ` in front."""
    return line.removeprefix("error: failed: ")


def is_up(project: str = DEFAULT_PROJECT, run_root: Path | None = None) -> bool:
    """Whether a supervisor of this project lives."""
    return StateDirectory(project, run_root).is_supervised()


def stop_stack(
    project: str = DEFAULT_PROJECT, run_root: Path | None = None, timeout_s: float = STOP_TIMEOUT_S + 2.0
) -> tuple[Stopped, ...]:
    """Take the stack down and return when it is gone; a supervisor that takes ``timeout_s`` is killed.

    Its guard ends the services then. Returns how each service ended, in the order of their ends; nothing where the
    supervisor was killed. Raises NotUpError if none runs.
    """
    directory = StateDirectory(project, run_root)
    pid = _supervisor_pid(directory)
    os.kill(pid, signal.SIGTERM)
    if not _wait_for(lambda: not directory.is_supervised(), timeout_s):
        os.kill(pid, signal.SIGKILL)
        _wait_for(lambda: not directory.is_supervised(), timeout_s)
        directory.clean_if_stale()
    if pid in _children:
        # The lock is free a moment before the process has ended.
        _children.pop(pid).wait()
    return directory.read_stopped(pid)


def _reap() -> None:
    for pid in [pid for pid, child in _children.items() if child.poll() is not None]:
        del _children[pid]


# Whoever took the stack down from another process left us its supervisor to wait for.
atexit.register(_reap)


def _supervisor_pid(directory: StateDirectory) -> int:
    found: list[int] = []

    def look() -> bool:
        # The supervisor takes the lock a moment before it writes its first state.
        state = directory.read() if directory.is_supervised() else None
        if state is not None:
            found.append(state.supervisor_pid)
        return state is not None or not directory.is_supervised()

    _wait_for(look, timeout_s=2.0)
    if not found:
        directory.clean_if_stale()
        raise NotUpError(f"project {directory.project!r} is not up")
    return found[0]


def _wait_for(condition: Callable[[], bool], timeout_s: float) -> bool:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(_POLL_S)
    return True
