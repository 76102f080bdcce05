"""`crosspih bench matrix`."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from crosspih_common.provenance import ResultStore, cell_identity, code_version, result_key
from services.operator.assembly.session import NEEDED
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.own_cell import SPEEDS, CellTask
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import base_cell_text
from services.operator.bench.options import AsJson, Cells, errors_shown
from services.operator.bench.reliability.kills.options import Phases, Seed, Speed, chosen
from services.operator.bench.reliability.matrix.ending import end_process
from services.operator.bench.reliability.matrix.judging import MatrixObservation, outcome
from services.operator.bench.reliability.matrix.page import COLUMNS, MatrixResult, section, write_section
from services.operator.bench.reliability.matrix.plan import PHASES, VICTIMS, MatrixCase, ProcessEnding, cases

WIDTH = 170
# the launcher, the recorder and the operator also react to an ended process, besides the cell's own code
MADE_BY = ("services", "deploy")


def case_key(case: MatrixCase, speed: str) -> str:
    """The key under which a case is stored: the case, the cell and the code."""
    cell = cell_identity(cell_content(base_cell_text(), Condition()))
    identity = {"case": case.model_dump(mode="json"), "speed": speed, "cell": cell, "code": code_version(*MADE_BY)}
    return result_key(identity)


def matrix(
    victim: Annotated[list[str] | None, typer.Option(help=f"{', '.join(VICTIMS)}; all when left out.")] = None,
    phase: Phases = None,
    ending: Annotated[
        list[ProcessEnding] | None, typer.Option("--signal", help="SIGSTOP lasts 7 s. All three when left out.")
    ] = None,
    speed: Speed = "realtime",
    seed: Seed = 1000,
    store: Annotated[Path, typer.Option(help="Results as JSON lines: cases in it are not run again.")] = Path(
        "matrix.jsonl"
    ),
    page: Annotated[
        Path | None, typer.Option(help="Write the table of all results in the store between this page's marks.")
    ] = None,
    cells: Cells = None,
    as_json: AsJson = False,
) -> None:
    """End every service, the router and the operator, in each phase of `crosspih assemble`, by each of three signals:
    outcome, time to the result, time until healthy, what the recording lost. Status 0 only if all cases hold.
    """
    console = Console(stderr=True)
    with (
        errors_shown(console),
        tempfile.TemporaryDirectory(prefix="crosspih-matrix-") as folder,
        ResultStore(store) as results,
    ):
        victims, phases = chosen("--victim", victim, VICTIMS), chosen("--phase", phase, PHASES)
        (speed,) = chosen("--speed", [speed], SPEEDS)
        planned = list(cases(victims, phases, chosen("--signal", ending, ProcessEnding), seed))
        keys = [case_key(case, speed) for case in planned]
        missing = [index for index, key in enumerate(keys) if results.get(key) is None]
        tasks = []
        for index in missing:
            overrides = {**planned[index].overrides, "recorder": {"directory": folder}}
            content = cell_content(base_cell_text(), Condition(name="matrix", overrides=overrides))
            payload = {"case": planned[index].model_dump(mode="json"), "folder": folder}
            tasks.append(
                CellTask(planned[index].name, content, end_process, payload, (*NEEDED, "recorder"), speed=speed)
            )
        progress = CellsProgress(console, "cases")
        progress.taken_over(len(planned), len(planned) - len(missing))
        if said := results.reuse_summary(code_version(*MADE_BY)):
            progress.say(said)

        def on_result(number: int, result: Any) -> None:
            index = missing[number]
            case, seen = planned[index], MatrixObservation.model_validate(result)
            code = code_version(*MADE_BY)
            results.put(keys[index], seen.model_dump(mode="json"), code=code, case=case.name, speed=speed)
            wrong = MatrixResult(case=case, seen=seen).complaints
            progress.say(f"{case.name}: {'; '.join([outcome(case, seen), *wrong])}", "red" if wrong else "")

        lost: dict[int, str] = {}
        if tasks:
            pool = open_executor(ExecutorName.LOCAL, cells, len(tasks))
            try:
                with progress:
                    lost = run_in_cells(tasks, pool, on_result, progress)
            except KeyboardInterrupt:
                console.print("interrupted: the same command goes on from here")
            finally:
                pool.close()
        rows = _rows(list(cases(VICTIMS, PHASES, ProcessEnding, seed)) if page else planned, results, speed)
        if page is not None:
            every = len(VICTIMS) * len(PHASES) * len(ProcessEnding)
            write_section(page, section(rows, f"crosspih bench matrix --speed {speed} --seed {seed}", every))
        if as_json:
            told_rows = [{**row.model_dump(mode="json"), "complaints": row.complaints} for row in rows]
            json.dump(told_rows, sys.stdout, indent=1)
            print()
        else:
            Console(width=WIDTH).print(table_of(rows))
        sound = [row for row in _rows(planned, results, speed) if not row.complaints]
        console.print(f"{len(sound)} of {len(planned)} cases hold", highlight=False)
        for number, why in lost.items():
            said = f"{planned[missing[number]].name}: lost its cell: {why}"
            console.print(said, style="red", markup=False, highlight=False)
        if len(sound) < len(planned):
            raise typer.Exit(1)


def table_of(rows: Sequence[MatrixResult]) -> Table:
    """One line per case."""
    table = Table()
    for name in COLUMNS:
        table.add_column(name, justify="right" if name.endswith(", s") else "left")
    for row in rows:
        table.add_row(*row.cells())
    return table


def _rows(planned: Sequence[MatrixCase], results: ResultStore, speed: str) -> list[MatrixResult]:
    rows = []
    for case in planned:
        seen = results.get(case_key(case, speed))
        if seen is not None:
            rows.append(MatrixResult(case=case, seen=MatrixObservation.model_validate(seen)))
    return rows
