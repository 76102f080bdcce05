"""`crosspih bench bus`: the cost of the typed bus compared with raw Zenoh on the same route, and other buses for the
same work.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer
from pydantic import BaseModel, ConfigDict
from rich.console import Console
from rich.table import Table

from services.operator.bench.cells.bar import Bar
from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.speed.bus import others
from services.operator.bench.speed.bus.figures import BusRound, WayFigures, figures_of
from services.operator.bench.speed.bus.processes import opened
from services.operator.bench.speed.bus.ways import PAYLOAD_BYTES, PYDANTIC, RAW


class BusResult(BaseModel):
    """What `crosspih bench bus --json` prints."""

    model_config = ConfigDict(frozen=True)

    payload_bytes: int
    rate_hz: float
    rounds: int
    ways: list[WayFigures]
    not_installed: list[str]


def measured(rounds: int, steady: int, burst: int, rate_hz: float, console: Console | None = None) -> BusResult:
    """All ways in turn, every second round in the opposite order. Raises CrosspihError."""
    taken: list[dict[str, BusRound]] = []
    with (
        tempfile.TemporaryDirectory(prefix="crosspih-bus-") as folder,
        opened(Path(folder)) as (take_turn, ways),
        Bar(console) as progress,
    ):
        bar = progress.add_task("bus", total=rounds * len(ways))
        for index in range(rounds):
            turns: dict[str, BusRound] = {}
            for name in list(ways)[:: -1 if index % 2 else 1]:
                progress.update(bar, description=name)
                turns[name] = take_turn(ways[name], steady, burst, rate_hz)
                progress.advance(bar)
            taken.append({name: turns[name] for name in ways})
    return BusResult(
        payload_bytes=PAYLOAD_BYTES, rate_hz=rate_hz, rounds=rounds, ways=figures_of(taken, RAW, PYDANTIC),
        not_installed=others.missing(),
    )  # fmt: skip


def table_of(result: BusResult) -> Table:
    """One row per way."""
    table = Table(title=f"{result.payload_bytes} bytes a sample, two processes; delays at {result.rate_hz:g} Hz")
    for name in ("", "p50 µs", "p95 µs", "p50 / raw", "messages/s", "/ raw", "/ pydantic", "CPU µs", "lost"):
        table.add_column(name, justify="left" if name == "" else "right")
    for row in result.ways:
        table.add_row(
            row.way, f"{row.p50_us:.0f}", f"{row.p95_us:.0f}", f"{row.p50_ratio:.2f}", f"{row.messages_s:,.0f}",
            f"{row.throughput_ratio:.2f}", f"{row.throughput_of_pydantic:.2f}",
            f"{row.send_cpu_us:.1f} + {row.hear_cpu_us:.1f}", f"{row.lost:.1%}",
        )  # fmt: skip
    table.caption = (
        "/ raw and / pydantic: against raw Zenoh, and raw Zenoh with pydantic-core's own dump and validate, of the "
        "same round; CPU: of the sender + the listener for a sample of a burst"
    )
    if result.not_installed:
        table.caption += f"; not installed: {', '.join(result.not_installed)} (the extra bench-peers)"
    return table


def bus(
    rounds: Annotated[int, typer.Option(min=1, help="Each way has a turn in each; ratios are medians over them.")] = 9,
    steady: Annotated[int, typer.Option(min=10, help="Samples of a turn at the steady rate.")] = 500,
    burst: Annotated[int, typer.Option(min=10, help="Samples of a turn as fast as they go.")] = 10_000,
    rate_hz: Annotated[float, typer.Option(min=1.0, help="The steady rate.")] = 1000.0,
    as_json: AsJson = False,
) -> None:
    """Measure the typed bus, from publishing to the callback in another process, beside raw Zenoh on the same route and
    other buses that are installed."""
    console = Console(stderr=True)
    with errors_shown(console):
        result = measured(rounds, steady, burst, rate_hz, console)
        if as_json:
            sys.stdout.write(result.model_dump_json(indent=1) + "\n")
        else:
            Console().print(table_of(result))
