"""`crosspih bench recorder`: how fast samples get from the bus into a file, beside the bare MCAP writer."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import ExitStack
from typing import Annotated

import numpy as np
import typer
from pydantic import BaseModel, ConfigDict
from rich.console import Console
from rich.table import Table

from crosspih_common.errors import CrosspihError
from crosspih_common.modules import module_command
from services.operator.bench.cells.bar import Bar
from services.operator.bench.options import AsJson, told

# the operator has no recorder in it: the recorder's own program measures
PROGRAM = "services.recorder.rate"


class RecorderResult(BaseModel):
    """What `crosspih bench recorder --json` prints: samples a second, medians; ratios are medians over the rounds."""

    model_config = ConfigDict(frozen=True)

    bare_s: float
    ours_s: float
    ratio: float
    bare_cpu_s: float
    ours_cpu_s: float
    cpu_ratio: float
    cells: int
    rate_hz: float
    sent: int
    lost: int


def result_of(rates: dict[str, list[float]], beside: list[dict[str, float]], rate_hz: float) -> RecorderResult:
    """From what the program printed: of the rounds in turn, and of the cells side by side."""
    bare, ours, bare_cpu, ours_cpu = (np.array(rates[name]) for name in ("bare", "ours", "bare_cpu", "ours_cpu"))
    return RecorderResult(
        bare_s=float(np.median(bare)), ours_s=float(np.median(ours)), ratio=float(np.median(ours / bare)),
        bare_cpu_s=float(np.median(bare_cpu)), ours_cpu_s=float(np.median(ours_cpu)),
        cpu_ratio=float(np.median(ours_cpu / bare_cpu)), cells=len(beside), rate_hz=rate_hz,
        sent=round(sum(one["samples"] for one in beside)), lost=round(sum(one["lost"] for one in beside)),
    )  # fmt: skip


def table_of(result: RecorderResult) -> Table:
    """Both rates and their ratio."""
    table = Table(title="samples a second, from the bus's callback to the file's end")
    for name in ("", "MCAP alone", "crosspih", "ratio"):
        table.add_column(name, justify="left" if name == "" else "right")
    table.add_row("by the wall's clock", f"{result.bare_s:,.0f}", f"{result.ours_s:,.0f}", f"{result.ratio:.2f}")
    table.add_row("of CPU time", f"{result.bare_cpu_s:,.0f}", f"{result.ours_cpu_s:,.0f}", f"{result.cpu_ratio:.2f}")
    if result.cells:
        table.caption = (
            f"{result.cells} cells at once, {result.rate_hz:,.0f} samples a second each: {result.lost} of "
            f"{result.sent:,} lost"
        )
    return table


def _started(stack: ExitStack, *words: str) -> subprocess.Popen[str]:
    """It ends with the stack, if not before."""
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
    with told(console), Bar(console) as progress, ExitStack() as stack:
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
