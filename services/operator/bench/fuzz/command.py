"""`crosspih bench fuzz`."""

from __future__ import annotations

import json
import sys
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from crosspih_common.errors import ConfigError
from services.operator.bench.conditions import Condition, cell_content
from services.operator.bench.fuzz.attacking import Attacked, attack
from services.operator.bench.fuzz.decoding import Decoded, decode_all, kinds
from services.operator.bench.options import AsJson, told
from services.operator.bench.own_cell import CellTask
from services.operator.bench.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.progress import CellsProgress
from services.operator.bench.trials import base_cell_text
from services.operator.session import NEEDED


def fuzz(
    payloads: Annotated[int, typer.Option(min=1, help="Decoded for each key of the table.")] = 100_000,
    asked: Annotated[int, typer.Option(min=0, help="Sent to each command and topic of a running cell.")] = 1000,
    seed: Annotated[int, typer.Option(help="All payloads are drawn from it.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Draw payloads from every message's own schema, sound, absurd and broken; decode them, and send them to a cell.

    Ends with status 0 only if each was taken or refused by name: no other error, no empty or `internal` answer, no
    traceback, no service that ended, and an assembly afterwards that inserts.
    """
    console = Console(stderr=True)
    with told(console):
        decoded = _decode(console, payloads, seed)
        attacked = _attack(console, asked, seed) if asked else None
        if as_json:
            rows = [
                {"key": row.key, "accepted": row.accepted, "rejected": row.rejected, "escaped": dict(row.escaped)}
                for row in decoded
            ]
            json.dump({"decoded": rows, "cell": attacked and attacked.model_dump(mode="json")}, sys.stdout, indent=1)
            print()
        else:
            _print(Console(width=140), decoded, attacked)
        escaped = [f"{row.key}: {what}" for row in decoded for what in row.escaped]
        defects = [*escaped, *(attacked.defects if attacked else ())]
        for line in defects[:50]:
            console.print(line, highlight=False, markup=False)
        sent = sum(row.sent for row in decoded)
        console.print(f"{sent} payloads of {len(decoded)} keys were decoded; {len(defects)} defects", highlight=False)
        if defects:
            raise typer.Exit(1)


def _decode(console: Console, payloads: int, seed: int) -> list[Decoded]:
    rows = []
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("keys decoded", total=len(kinds()))
        for key, kind in kinds().items():
            rows.append(decode_all(key, kind, payloads, seed))
            progress.advance(bar)
    return rows


def _attack(console: Console, asked: int, seed: int) -> Attacked:
    content = cell_content(base_cell_text(), Condition())
    task = CellTask("fuzz", content, attack, {"count": asked, "seed": seed}, (*NEEDED, "recorder"))
    results: list[Attacked] = []
    pool = open_executor(ExecutorName.LOCAL, 1, 1)
    progress = CellsProgress(console, "cells")
    progress.taken_over(1, 0)

    def on_result(_: int, result: Any) -> None:
        results.append(Attacked.model_validate(result))

    try:
        with progress:
            lost = run_in_cells([task], pool, on_result, progress)
    finally:
        pool.close()
    if lost:
        raise ConfigError(f"the cell was lost: {next(iter(lost.values()))}")
    return results[0]


def _print(console: Console, decoded: list[Decoded], attacked: Attacked | None) -> None:
    table = Table(title="decoded, key by key")
    for name in ("key", "accepted", "rejected", "any other error"):
        table.add_column(name, justify="left" if name == "key" else "right")
    for row in decoded:
        table.add_row(row.key, str(row.accepted), str(row.rejected), str(sum(row.escaped.values())))
    console.print(table)
    if attacked is None:
        return
    table = Table(title=f"asked of a running cell; {attacked.samples} samples beside")
    for name in ("command", "accepted", "refused by name", "internal", "no answer"):
        table.add_column(name, justify="left" if name == "command" else "right")
    for answered in attacked.commands:
        counts = dict(answered.answers)
        figures = [counts.pop(name, 0) for name in ("accepted", "internal", "no answer")]
        table.add_row(answered.command, str(figures[0]), str(sum(counts.values())), str(figures[1]), str(figures[2]))
    console.print(table)
    grown = ", ".join(f"{name} {value:+.1f}" for name, value in attacked.grown_mb.items())
    console.print(f"memory, MB: {grown}; assembly afterwards: {'inserted' if attacked.inserted else attacked.failure}")
