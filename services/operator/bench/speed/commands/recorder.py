"""`crosspih bench recorder`."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import ExitStack
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.errors import CrosspihError
from crosspih_common.modules import module_command
from services.operator.bench.cells.bar import Bar
from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.speed.recorder import PROGRAM, result_of, table_of


def _started(stack: ExitStack, *words: str) -> subprocess.Popen[str]:
    """Start a process that ends with the stack, if not before."""
    process = subprocess.Popen(
        module_command(PROGRAM, *words), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    stack.enter_context(process)
    stack.callback(process.kill)
    return process


def _said(process: subprocess.Popen[str]) -> str:
    out, err = process.communicate()
    if process.returncode != 0:
        raise CrosspihError(f"bench recorder: {(err.strip().splitlines() or ['it died'])[-1]}")
    return out.strip().splitlines()[-1]


def recorder(
    samples: Annotated[int, typer.Option(min=100, help="Samples a round; five rounds, each way in turn.")] = 20_000,
    cells: Annotated[int, typer.Option(min=0, help="Recorders side by side, each with samples at --rate-hz.")] = 4,
    rate_hz: Annotated[float, typer.Option(min=1.0, help="Four times what a cell sends in real time.")] = 1800.0,
    as_json: AsJson = False,
) -> None:
    """Measure how fast samples get from the bus into a file beside the bare MCAP writer, and whether four cells at once
    lose any."""
    console = Console(stderr=True)
    with errors_shown(console), Bar(console) as progress, ExitStack() as stack:
        bar = progress.add_task("recorder, in turn with MCAP alone", total=2)
        rates: dict[str, list[float]] = json.loads(_said(_started(stack, "--steps", str(samples))))
        progress.update(bar, completed=1, description=f"{cells} cells at once")
        running = [_started(stack, "--steps", str(samples), "--paced", str(rate_hz)) for _ in range(cells)]
        beside: list[dict[str, float]] = [json.loads(_said(one)) for one in running]
        progress.update(bar, completed=2)
        result = result_of(rates, beside, rate_hz)
    if as_json:
        sys.stdout.write(result.model_dump_json(indent=1) + "\n")
    else:
        Console().print(table_of(result))
