"""`crosspih bench fuzz`."""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.errors import CrosspihError
from crosspih_common.provenance import ResultStore, code_version
from services.operator.assembly.session import NEEDED
from services.operator.bench.cells.conditions import Condition, cell_content, merged
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import base_cell_text
from services.operator.bench.options import AsJson, Store, errors_shown
from services.operator.bench.reliability.fuzz.attacking import AttackedPart, attack, parts
from services.operator.bench.reliability.fuzz.decoding_all import AllDecoded, decode_every_key
from services.operator.bench.reliability.fuzz.rests_on import part_key
from services.operator.bench.reliability.fuzz.tables import Attacked, decoded_table, markdown, parts_table, summary

MAX_SHOWN = 50
# a valid motion of two minutes would delay all later payloads
SHORT_MOTIONS = {"hardware": {"limits": {"motion_s": 15.0}}}


class _TimeIsUp(CrosspihError):
    """The time of `--minutes`."""


def fuzz(
    payloads: Annotated[int, typer.Option(min=0, help="Decoded for each key of the table.")] = 100_000,
    asked: Annotated[int, typer.Option(min=0, help="Sent to each command and topic of a running cell.")] = 1000,
    seed: Annotated[int, typer.Option(help="All payloads are drawn from it.")] = 1,
    only: Annotated[list[str] | None, typer.Option(help="Of the cell only this command or topic; repeat it.")] = None,
    minutes: Annotated[float | None, typer.Option(min=0.0, help="End after so long with what was done.")] = None,
    store: Store = None,
    table: Annotated[Path | None, typer.Option(help="The counts as a page in Markdown.")] = None,
    as_json: AsJson = False,
) -> None:
    """Draw payloads from every message's own schema, sound, absurd and broken; decode them, and send them to a cell.

    Ends with status 0 only if each was taken or refused by name: no other error, no empty or `internal` answer, no
    traceback, no service that ended, and an assembly afterwards that inserts. Stopped with Ctrl-C or by --minutes it
    shows what was done by then; with --store the same command goes on from there.
    """
    console = Console(stderr=True)
    until = math.inf if minutes is None else time.time() + 60.0 * minutes
    with errors_shown(console):
        unknown = sorted(set(only or ()) - set(parts()))
        if unknown:
            raise CrosspihError(f"--only {unknown[0]}: no command or topic; crosspih keys lists them")
        kept = None if store is None else ResultStore(store)
        try:
            decoded, interrupted = decode_every_key(console, payloads, seed, until, kept)
            attacked = Attacked()
            if asked and not interrupted:
                wanted = [part for part in parts() if only is None or part in only]
                interrupted = _attack(console, attacked, wanted, asked, seed, until, kept)
        finally:
            if kept is not None:
                kept.close()
        if as_json:
            json.dump(_content(decoded, attacked), sys.stdout, indent=1)
            print()
        else:
            _print(Console(width=140), decoded, attacked)
        if table is not None:
            table.parent.mkdir(parents=True, exist_ok=True)
            table.write_text(markdown(decoded, attacked, payloads, asked, seed), encoding="utf-8")
        defects = [f"{row.key}: {what}" for row in decoded.rows.values() for what in row.escaped] + attacked.defects
        defects += [decoded.failure] if decoded.failure else []
        for line in defects[:MAX_SHOWN]:
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        console.print(summary(decoded, attacked, len(defects)), highlight=False, soft_wrap=True)
        if interrupted:
            raise typer.Exit(130)
        if defects:
            raise typer.Exit(1)


def _attack(
    console: Console, attacked: Attacked, wanted: list[str], asked: int, seed: int, until: float,
    store: ResultStore | None,
) -> bool:  # fmt: skip
    """One part after another in one cell; parts in the store are taken from there. Returns whether it
    was interrupted.
    """
    content = merged(cell_content(base_cell_text(), Condition()), SHORT_MOTIONS)
    keys = {part: part_key(part, asked, seed, content) for part in wanted}
    known = {part: row for part in wanted if store is not None and (row := store.get(keys[part])) is not None}
    attacked.parts += [AttackedPart.model_validate(row) for row in known.values()]
    left = [part for part in wanted if part not in known]
    tasks = [
        CellTask(
            part, content, attack, {"part": part, "count": asked, "seed": seed, "until": until}, (*NEEDED, "recorder")
        )
        for part in left
    ]
    if not tasks or time.time() > until:
        return False

    def on_result(index: int, result: Any) -> None:
        part = AttackedPart.model_validate(result)
        attacked.parts.append(part)
        if part.told:
            progress.say(f"{part.told[0][:300]} ({len(part.told)} defects)", "red")
        if time.time() > until:
            raise _TimeIsUp("the time is up; what was answered by now is counted")
        if store is not None:
            store.put(keys[left[index]], result, code=code_version(), part=left[index])

    pool = open_executor(ExecutorName.LOCAL, 1, 1)
    progress = CellsProgress(console, "commands and topics")
    progress.taken_over(len(wanted), len(known))
    try:
        with progress:
            lost = run_in_cells(tasks, pool, on_result, progress)
        attacked.lost += [f"{left[index]}: the cell was lost: {why}" for index, why in lost.items()]
    except _TimeIsUp as ended:
        console.print(str(ended), highlight=False)
    except KeyboardInterrupt:
        return True
    finally:
        pool.close()
    return False


def _content(decoded: AllDecoded, attacked: Attacked) -> dict[str, Any]:
    rows = [
        {"key": row.key, "accepted": row.accepted, "rejected": row.rejected, "escaped": dict(row.escaped)}
        for row in decoded.rows.values()
    ]
    return {
        "decoded": rows,
        "decoding_grown_mb": round(decoded.grown_mb, 1),
        "cell": [part.model_dump(mode="json") for part in attacked.parts],
        "lost": attacked.lost,
    }


def _print(console: Console, decoded: AllDecoded, attacked: Attacked) -> None:
    if decoded.sent:
        console.print(decoded_table(decoded))
    if attacked.parts:
        console.print(parts_table(attacked))
        grown = ", ".join(f"{name} {value:+.1f}" for name, value in attacked.grown_mb.items())
        console.print(f"memory grown since the first of them was done, MB: {grown}", highlight=False)
