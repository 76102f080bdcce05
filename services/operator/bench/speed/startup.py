"""`crosspih bench startup`: a stack from nothing to all ready, compared with the slowest single import of its services,
and the CPU time of small commands.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from statistics import median
from typing import Any

from pydantic import BaseModel, ConfigDict
from rich.console import Console
from rich.table import Table

from crosspih_common.errors import CrosspihError
from crosspih_common.modules import module_command
from services.operator.assembly.session import NEEDED
from services.operator.bench.cells.bar import Bar
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.own_cell import CellTask, OwnCell
from services.operator.bench.cells.trials import base_cell_text

SERVICES = (*NEEDED, "recorder")
COMMANDS: dict[str, tuple[str, ...]] = {"--help": ("--help",), "ps": ("ps",), "keys": ("keys",)}


class Import(BaseModel):
    """One process that only imports what a service imports, medians."""

    model_config = ConfigDict(frozen=True)

    service: str
    wall_s: float
    cpu_s: float


class StartupResult(BaseModel):
    """What `crosspih bench startup --json` prints: medians over the rounds."""

    model_config = ConfigDict(frozen=True)

    python_cpu_s: float
    commands_cpu_s: dict[str, float]
    imports: list[Import]
    ready_s: float
    ready_ratio: float


def timed(command: list[str]) -> tuple[float, float]:
    """Wall and CPU time, s, of a process with all that it started. Raises CrosspihError where it ends by a signal or
    cannot import a module.
    """
    began_s = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    with process.stderr:
        said = process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode < 0 or "ModuleNotFoundError" in said:
        last = (said.strip().splitlines() or ["it died"])[-1]
        raise CrosspihError(f"bench startup: {' '.join(command[-2:])}: {last}")
    return time.perf_counter() - began_s, used.ru_utime + used.ru_stime


def importing(service: str) -> list[str]:
    """The command that imports what a service imports, and ends."""
    return [sys.executable, "-c", f"import services.{service}.__main__"]


def until_ready_s(content: dict[str, Any]) -> float:
    """Start a stack of a cell's file and wait until all its services are ready; it is stopped afterwards."""
    cell = OwnCell(0, CellTask("startup", content, lambda session, payload: None, None, SERVICES, calibrate=False))
    began_s = time.perf_counter()
    try:
        cell.start()
        return time.perf_counter() - began_s
    finally:
        cell.close()


def measured(rounds: int, console: Console | None = None, stack: bool = True) -> StartupResult:
    """All in turn, this many times. Raises CrosspihError or LauncherError."""
    plain: list[float] = []
    ready: list[float] = []
    commands: dict[str, list[float]] = {name: [] for name in COMMANDS}
    imports: dict[str, list[tuple[float, float]]] = {service: [] for service in SERVICES}
    # once: a stack puts its own file into the environment, and that file is removed with it
    content = cell_content(base_cell_text(), Condition())
    with Bar(console) as progress:
        bar = progress.add_task("startup", total=rounds * (1 + len(commands) + len(imports) + stack))
        for _ in range(rounds):
            plain.append(timed([sys.executable, "-c", "pass"])[1])
            progress.advance(bar)
            for name, words in COMMANDS.items():
                commands[name].append(timed(module_command("services.operator", *words))[1])
                progress.advance(bar)
            for service in imports:
                imports[service].append(timed(importing(service)))
                progress.advance(bar)
            if stack:
                ready.append(until_ready_s(content))
                progress.advance(bar)
    rows = [
        Import(service=service, wall_s=median(wall for wall, _ in each), cpu_s=median(cpu for _, cpu in each))
        for service, each in imports.items()
    ]
    ready_s = median(ready) if ready else 0.0
    return StartupResult(
        python_cpu_s=median(plain), commands_cpu_s={name: median(each) for name, each in commands.items()},
        imports=rows, ready_s=ready_s, ready_ratio=ready_s / max(row.wall_s for row in rows),
    )  # fmt: skip


def table_of(result: StartupResult) -> Table:
    """A row a process, and the stack in the caption."""
    table = Table(title="starting", caption=(
        f"a stack until all are ready: {result.ready_s:.2f} s, {result.ready_ratio:.2f} times the slowest single import"
    ))  # fmt: skip
    for name in ("", "wall s", "CPU s"):
        table.add_column(name, justify="left" if name == "" else "right")
    table.add_row("python -c pass", "", f"{result.python_cpu_s:.2f}")
    for command, cpu_s in result.commands_cpu_s.items():
        table.add_row(f"crosspih {command}", "", f"{cpu_s:.2f}")
    for row in sorted(result.imports, key=lambda row: -row.wall_s):
        table.add_row(f"import of services.{row.service}", f"{row.wall_s:.2f}", f"{row.cpu_s:.2f}")
    return table
