"""``crosspih ps`` and ``logs``: what a stack is doing, and what it wrote. They load what reading needs, no more."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from crosspih_common.errors import CrosspihError
from crosspih_common.modules import RUN_DIR_VARIABLE
from deploy.launcher.display import LogView, TerminalConsole, services_table
from deploy.launcher.errors import LauncherError, NotUpError
from deploy.launcher.logfile import LogTail, merged
from deploy.launcher.state import DEFAULT_PROJECT, StackState, StateDirectory

_FOLLOW_S = 0.1

Project = Annotated[str, typer.Option("--project", "-p", envvar="CROSSPIH_PROJECT", help="Name of the stack.")]
RunDir = Annotated[
    Path | None, typer.Option("--run-dir", envvar=RUN_DIR_VARIABLE, help="Where stacks keep state and logs.")
]
Services = Annotated[list[str] | None, typer.Argument(metavar="[SERVICE]...", help="Only these (and what they need).")]


@contextmanager
def one_line_errors() -> Iterator[None]:
    """What the launcher cannot do is one line on standard error, and status 1."""
    try:
        yield
    except CrosspihError as error:
        print(error, file=sys.stderr, flush=True)
        raise typer.Exit(1) from None
    except BrokenPipeError:
        # The reader has gone (crosspih logs | head); the interpreter's last flush must not say so again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(0) from None


def ps(
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
    project: Project = DEFAULT_PROJECT,
    run_dir: RunDir = None,
) -> None:
    """Show the services, their health and their restarts; exit status 1 if the stack is not up."""
    show_stack(as_json, project, run_dir)


def show_stack(
    as_json: bool,
    project: str,
    run_dir: Path | None,
    add_notes: Callable[[StackState], StackState] = lambda state: state,
) -> None:
    """What `ps` does; `add_notes` puts what the launcher does not know into the notes. Raises typer.Exit."""
    with one_line_errors():
        directory = StateDirectory(project, run_dir)
        stale_pid = directory.clean_if_stale()
        state = directory.read()
        if state is not None and not state.finished:
            state = add_notes(state)
        if state is None:
            why = f"; its supervisor (pid {stale_pid}) died, and its state was removed" if stale_pid else ""
            said = f"project {project!r} is not up{why}"
            if as_json:
                error = {"code": "not_up", "text": said, "field": "--project", "mend": "crosspih up"}
                print(json.dumps({"project": project, "up": False, "services": [], "error": error}))
            raise NotUpError(said)
        if as_json:
            print(json.dumps({**state.model_dump(mode="json"), "up": not state.finished}))
        if not as_json:
            TerminalConsole(highlight=False).print(services_table(state), soft_wrap=True)
        if state.finished:
            raise typer.Exit(1)


def logs(
    services: Services = None,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on until the stack ends or Ctrl-C.")] = False,
    tail: Annotated[
        int | None, typer.Option("--tail", "-n", min=0, help="Only the last lines of what is there.")
    ] = None,
    project: Project = DEFAULT_PROJECT,
    run_dir: RunDir = None,
) -> None:
    """Show what the services of the running, or of the last, stack wrote, in the order of time."""
    with one_line_errors():
        directory = StateDirectory(project, run_dir)
        known = directory.tails()
        for name in services or ():
            if name not in known:
                raise LauncherError(f"no logs of {name!r}; there are logs of {', '.join(known) or 'no service'}")
        tails = {name: reader for name, reader in known.items() if not services or name in services}
        if not tails and not directory.is_supervised():
            raise NotUpError(f"project {project!r} has no logs")
        view = LogView(TerminalConsole(highlight=False), tails)
        past = list(merged(list(tails.values())))
        for line in past[len(past) - min(tail, len(past)) :] if tail is not None else past:
            view.show(line)
        if follow:
            try:
                _follow(directory, tails, tuple(services or ()), view)
            except KeyboardInterrupt:
                raise typer.Exit(0) from None


def _follow(directory: StateDirectory, tails: dict[str, LogTail], services: tuple[str, ...], view: LogView) -> None:
    while True:
        alive = directory.is_supervised()  # Asked before reading, so that the last lines are not missed.
        if not services:
            for name, reader in directory.tails().items():
                tails.setdefault(name, reader)
        for line in merged(list(tails.values())):
            view.show(line)
        if not alive:
            return
        time.sleep(_FOLLOW_S)
