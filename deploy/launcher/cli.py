"""``crosspih up``, ``ps``, ``logs`` and ``down``: plain typer functions, for the operator's command line to register.

register(app)            adds the four commands to a typer app
python -m deploy.launcher.cli up    is the same without the rest of the system
"""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from crosspih_common.modules import DEFAULT_CELL
from deploy.launcher.certificates import require_certificates
from deploy.launcher.display import LogView, TerminalConsole, stopped_lines
from deploy.launcher.foreground import supervise
from deploy.launcher.looking import Project, RunDir, Services, logs, one_line_errors, ps
from deploy.launcher.port import require_free_port
from deploy.launcher.stack import DEFAULT_COMPOSE_FILE, StackRequest, is_up, start_stack, stop_stack
from deploy.launcher.state import DEFAULT_PROJECT
from deploy.launcher.supervisor import STOP_TIMEOUT_S


def up(
    services: Services = None,
    detach: Annotated[bool, typer.Option("--detach", "-d", help="Run in the background.")] = False,
    wait: Annotated[bool, typer.Option("--wait", help="With -d: return when all services are healthy.")] = False,
    wait_timeout_s: Annotated[float, typer.Option("--wait-timeout", help="Seconds to wait at most.")] = 60.0,
    compose_file: Annotated[Path, typer.Option("--file", "-f", help="Compose file.")] = DEFAULT_COMPOSE_FILE,
    profile: Annotated[list[str] | None, typer.Option("--profile", help="Profile to switch on.")] = None,
    timeout_s: Annotated[
        float, typer.Option("--timeout", "-t", help="Seconds in which all services stop at the end.")
    ] = STOP_TIMEOUT_S,
    project: Project = DEFAULT_PROJECT,
    run_dir: RunDir = None,
) -> None:
    """Start the services and show what they write; Ctrl-C stops them all."""
    with one_line_errors():
        if compose_file == DEFAULT_COMPOSE_FILE:
            # what is wrong in what all services share is said once, and before any of them starts
            from crosspih_common.config import load_cell  # it loads NumPy, which ps and down do without

            load_cell(os.environ.get("CROSSPIH_CELL") or DEFAULT_CELL)
            if not is_up(project, run_dir):
                require_free_port()
        request = StackRequest(project, compose_file, tuple(services or ()), tuple(profile or ()), run_dir, timeout_s)
        request = request.with_what_comes_by_itself()
        require_certificates(request.chosen())
        if detach:
            console = TerminalConsole(highlight=False)
            state = start_stack(request, wait, wait_timeout_s, on_change=console.print)
            for row in state.services:
                if row.note:
                    console.print(f"{row.service}: {row.note}", soft_wrap=True)
            return
        view = LogView(TerminalConsole(highlight=False), request.chosen())
        raise typer.Exit(supervise(request, view.show, whole=True))


def down(project: Project = DEFAULT_PROJECT, run_dir: RunDir = None) -> None:
    """Stop all services, in order, and the supervisor; say how each of them ended."""
    with one_line_errors():
        began_s = time.monotonic()
        stopped = stop_stack(project, run_dir)
        for line in stopped_lines(stopped, time.monotonic() - began_s):
            print(line)


def register(app: typer.Typer, ps: Callable[..., None] = ps) -> None:
    """Add ``up``, ``ps``, ``logs`` and ``down`` to ``app``; ``ps`` may be one that knows more."""
    for command in (up, ps, logs, down):
        app.command()(command)


app = typer.Typer(no_args_is_help=True, add_completion=False, help="Runs a compose file as local processes.")
register(app)

if __name__ == "__main__":
    app()
