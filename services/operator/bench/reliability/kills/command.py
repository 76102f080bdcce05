"""`crosspih bench kills`."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from pydantic import BaseModel
from rich.console import Console
from rich.table import Table

from services.operator.assembly.session import NEEDED
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.own_cell import SPEEDS, CellTask
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import base_cell_text
from services.operator.bench.options import AsJson, Cells, errors_shown
from services.operator.bench.reliability.kills.ending import end_service
from services.operator.bench.reliability.kills.judging import Limits, Observed, complaints
from services.operator.bench.reliability.kills.options import Phases, Seed, Speed, chosen
from services.operator.bench.reliability.kills.plan import PHASES, SERVICES, KillCase, ServiceEnding, cases

WIDTH = 170


class KillResult(BaseModel):
    """One case, its observation, and everything that is wrong."""

    speed: str
    case: KillCase
    observed: Observed
    complaints: list[str]


def _limits(content: dict[str, Any]) -> Limits:
    limits = (content.get("hardware") or {}).get("limits") or {}
    return Limits(
        force_cap_n=float(limits.get("force_cap_n", 60.0)),
        holder_timeout_s=float(limits.get("holder_timeout_s", 0.1)),
    )


def _ended(seen: Observed) -> str:
    if not seen.signalled:
        return "never got there"
    if seen.ended_s is None:
        return "never"
    if seen.inserted:
        return "inserted"
    if seen.failure is not None:
        return seen.failure.value + (", peg out" if seen.backed_off else "")
    return "the asker was told" if seen.asker_told else "without a word"


def _peg(seen: Observed) -> str:
    if seen.tip_before_m is None:
        return "cell anew" if seen.signalled else ""
    return (
        f"{seen.tip_before_m * 1e3:.0f} mm before" if seen.tip_before_m > 0 else f"{-seen.tip_before_m * 1e3:.0f} mm in"
    )


def table_of(rows: Sequence[KillResult], speed: str) -> Table:
    """One line per case."""
    table = Table(title=f"a service ended in the middle of an assembly; the cell at {speed}")
    for name, justify in (
        ("service", "left"), ("signal", "left"), ("phase", "left"), ("|F| then, N", "right"), ("motion then", "left"),
        ("beats, s", "right"), ("arm stops, s", "right"), ("named, s", "right"), ("by", "left"), ("assembly", "left"),
        ("ends, s", "right"), ("peak after, N", "right"), ("tip, from the face", "right"), ("holds", "left"),
    ):  # fmt: skip
        table.add_column(name, justify="right" if justify == "right" else "left")
    for row in rows:
        case, seen = row.case, row.observed

        def figure(value: float | None, digits: int = 2) -> str:
            return "" if value is None else f"{value:.{digits}f}"

        table.add_row(
            case.service, case.ending.value, case.phase.value, figure(seen.force_n, 1), seen.stop_reason or "none",
            figure(seen.beats_s, 3), figure(seen.stop_s, 3), figure(seen.named_s), seen.named_by, _ended(seen),
            figure(seen.ended_s, 1), figure(seen.peak_n, 1), _peg(seen), "[red]no[/red]" if row.complaints else "yes",
        )  # fmt: skip
    return table


def kills(
    service: Annotated[list[str] | None, typer.Option(help=f"{', '.join(SERVICES)}; all when left out.")] = None,
    phase: Phases = None,
    ending: Annotated[
        list[ServiceEnding] | None,
        typer.Option("--signal", help="SIGKILL: it is gone; SIGSTOP: it hangs. Both without it."),
    ] = None,
    speed: Speed = "realtime",
    seed: Seed = 1000,
    cells: Cells = None,
    as_json: AsJson = False,
) -> None:
    """End each service in each phase of an assembly, and print what becomes of arm, peg and assembly. Ends with
    status 0 only if the arm always stops in time, the loss is named within a second, and all ends in order.
    """
    console = Console(stderr=True)
    with errors_shown(console), tempfile.TemporaryDirectory(prefix="crosspih-kills-") as recordings:
        services, phases = chosen("--service", service, SERVICES), chosen("--phase", phase, PHASES)
        (speed,) = chosen("--speed", [speed], SPEEDS)
        planned = list(cases(services, phases, chosen("--signal", ending, ServiceEnding), seed))
        tasks, limits = [], []
        for case in planned:
            overrides = {**case.overrides, "recorder": {"directory": recordings}}
            content = cell_content(base_cell_text(), Condition(name="kills", overrides=overrides))
            limits.append(_limits(content))
            tasks.append(
                CellTask(
                    case.name, content, end_service, case.model_dump(mode="json"), (*NEEDED, "recorder"), speed=speed
                )
            )
        found: dict[int, KillResult] = {}
        progress = CellsProgress(console, "cases")
        progress.taken_over(len(tasks), 0)

        def on_result(index: int, result: Any) -> None:
            seen, case = Observed.model_validate(result), planned[index]
            wrong = complaints(case, seen, limits[index])
            found[index] = KillResult(speed=speed, case=case, observed=seen, complaints=wrong)
            progress.say(f"{case.name}: {'; '.join([_ended(seen), *wrong])}", "red" if wrong else "")

        pool = open_executor(ExecutorName.LOCAL, cells, len(tasks))
        lost: dict[int, str] = {}
        try:
            with progress:
                lost = run_in_cells(tasks, pool, on_result, progress)
        except KeyboardInterrupt:
            console.print("interrupted: what was seen so far")
        finally:
            pool.close()
    rows = [found[index] for index in sorted(found)]
    if as_json:
        json.dump([row.model_dump(mode="json") for row in rows], sys.stdout, indent=1)
        print()
    else:
        Console(width=WIDTH).print(table_of(rows, speed))
    sound = [row for row in rows if not row.complaints]
    console.print(f"{len(sound)} of {len(tasks)} cases hold", highlight=False)
    for index, why in lost.items():
        console.print(f"{planned[index].name}: lost its cell: {why}", style="red", markup=False, highlight=False)
    if len(sound) < len(tasks):
        raise typer.Exit(1)
