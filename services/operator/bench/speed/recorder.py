"""`crosspih bench recorder`: how fast samples get from the bus into a file, compared with the bare MCAP writer."""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict
from rich.table import Table

# the operator imports no recorder: a program of the recorder measures
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
    shown_s: float
    shown_ratio: float
    cells: int
    rate_hz: float
    sent: int
    lost: int


def result_of(rates: dict[str, list[float]], beside: list[dict[str, float]], rate_hz: float) -> RecorderResult:
    """The result from the program's output: of the rounds in turn, and of the cells side by side."""
    bare, ours, bare_cpu, ours_cpu = (np.array(rates[name]) for name in ("bare", "ours", "bare_cpu", "ours_cpu"))
    shown = np.array(rates["shown"])
    return RecorderResult(
        bare_s=float(np.median(bare)), ours_s=float(np.median(ours)), ratio=float(np.median(ours / bare)),
        bare_cpu_s=float(np.median(bare_cpu)), ours_cpu_s=float(np.median(ours_cpu)),
        cpu_ratio=float(np.median(ours_cpu / bare_cpu)), shown_s=float(np.median(shown)),
        shown_ratio=float(np.median(shown / bare)), cells=len(beside), rate_hz=rate_hz,
        sent=round(sum(one["samples"] for one in beside)), lost=round(sum(one["lost"] for one in beside)),
    )  # fmt: skip


def table_of(result: RecorderResult) -> Table:
    """Both rates and their ratio."""
    table = Table(title="samples a second, from the bus's callback to the file's end")
    for name in ("", "MCAP alone", "crosspih", "ratio"):
        table.add_column(name, justify="left" if name == "" else "right")
    table.add_row("by the wall's clock", f"{result.bare_s:,.0f}", f"{result.ours_s:,.0f}", f"{result.ratio:.2f}")
    table.add_row("of CPU time", f"{result.bare_cpu_s:,.0f}", f"{result.ours_cpu_s:,.0f}", f"{result.cpu_ratio:.2f}")
    table.add_row(
        "with topics for viewers, until all are made", "", f"{result.shown_s:,.0f}", f"{result.shown_ratio:.2f}"
    )
    if result.cells:
        table.caption = (
            f"{result.cells} cells at once, {result.rate_hz:,.0f} samples a second each: {result.lost} of "
            f"{result.sent:,} lost"
        )
    return table
