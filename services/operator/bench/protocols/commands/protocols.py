"""`crosspih bench protocols`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.messages import Strategy
from services.operator.bench.cells.bar import Bar
from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.protocols.addresses import private_network
from services.operator.bench.protocols.assembling import ProtocolResult, assembled, calibrated_cell, line_of, table_of
from services.operator.bench.protocols.plants import ADDRESSES, ProtocolWay, needs_private_network
from services.operator.bench.protocols.walked import check_walk


def protocols(
    way: Annotated[
        ProtocolWay,
        typer.Option(help="ur: RTDE, Net F/T and GigE Vision; ros2: ros2_control, WrenchStamped and Image topics."),
    ] = ProtocolWay.UR,
    trials: Annotated[int, typer.Option(min=1, help="One after the other, each with the next seed.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1000,
    strategy: Annotated[Strategy, typer.Option(help="How to get the peg in.")] = Strategy.FUSED,
    calibrated: Annotated[
        Path | None, typer.Option(help="A cell's file whose calibrations `crosspih bench day` has found.")
    ] = None,
    hidden: Annotated[int, typer.Option(min=0, help="With --calibrated: the seed of that day.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Assemble in real time in a cell whose every device is reached by its published protocol over loopback, and score
    by what only the other end knows. Status 1 where one was not inserted."""
    console = Console(stderr=True)
    with errors_shown(console):
        if needs_private_network(way):
            private_network(ADDRESSES)
        if calibrated is not None:
            check_walk(calibrated.resolve().parent, console, hidden=hidden)
        cell = None if calibrated is None else calibrated_cell(calibrated, hidden)
        rows = []
        with Bar(console) as bar:
            for one in bar.track(range(seed, seed + trials), description=f"by {way.value}"):
                rows.append(assembled(way, one, strategy, cell))
                said, style = line_of(rows[-1]), "" if rows[-1].inserted else "red"
                console.print(said, style=style, markup=False, highlight=False, soft_wrap=True)
        result = ProtocolResult(way=way.value, inserted=sum(row.inserted for row in rows), trials=rows)
        if as_json:
            sys.stdout.write(result.model_dump_json(indent=1) + "\n")
        else:
            Console(width=100).print(table_of(result))
        if result.inserted < trials:
            raise typer.Exit(1)
