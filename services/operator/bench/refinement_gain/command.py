"""`crosspih bench refine`: a cell that differs from its drawing; its recordings are refined, and the next seeds are run
before and after.

The simulator's truth is set here and known to the scoring alone; the refinement sees only the recordings.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml
from rich.console import Console
from rich.table import Table

from crosspih_common.errors import CrosspihError
from crosspih_common.keys import RECORD_START, RECORD_STOP
from crosspih_common.messages import StartRecording, StopRecording, Strategy
from services.operator.assembly.session import NEEDED, Session
from services.operator.bench.cells.conditions import DEFAULT_PEG, Condition, cell_content, condition_of, merged
from services.operator.bench.cells.own_cell import CALIBRATION_DWELL_S, CellTask
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import TrialJob, base_cell_text, trial_task
from services.operator.bench.options import AsJson, Cells, errors_shown
from services.operator.calibrate.refined_cell import refined_table, residual_lines, run_refine, write_cell
from services.operator.cell.settings import require_settings
from services.operator.scoring.score import TrialFigures
from services.operator.scoring.statistics import BenchResult, summarise

# 2 mm and 0.5° of the camera, 1 % of the taper, 0.05 mm of the hole, 0.2 mm and 0.2° of the F/T sensor
UNMODELLED: dict[str, Any] = {
    "taper_slope_factor": 1.01,
    "clearance_offset_m": 5e-5,
    "ft_shift_m": [0.00015, -0.0001, 0.0001],
    "ft_turn_rad": [0.0022, -0.002, 0.0018],
    "camera_shift_m": [0.0015, -0.0012, 0.0006],
    "camera_turn_rad": [0.006, -0.005, 0.004],
}
ROWS = (
    ("touches", "touches"),
    ("corrections", "corrections"),
    ("presses", "presses"),
    ("peak_force_n", "peak force, N"),
    ("motion_s", "motion, s"),
    ("vision_error_mm", "vision, mm"),
    ("vision_tilt_deg", "vision, tilt, °"),
    ("final_error_mm", "final, mm"),
    ("final_error_deg", "final, °"),
)


def recorded_calibration(session: Session, payload: dict[str, Any]) -> str:
    """A calibration of the F/T sensor with its recording; the recording's path."""
    session.bus.call(RECORD_START, StartRecording(name=payload["name"]), 15.0)
    try:
        session.calibrate_ft(payload["dwell_s"])
    finally:
        path = session.bus.call(RECORD_STOP, StopRecording(), 15.0).path
    if not path:
        raise CrosspihError("the recorder wrote no file")
    return str(Path(path).resolve())


def _done(console: Console, title: str, tasks: list[CellTask], cells: int | None) -> list[Any]:
    results: dict[int, Any] = {}
    progress = CellsProgress(console, title)
    progress.taken_over(len(tasks), 0)
    pool = open_executor(ExecutorName.LOCAL, cells, len(tasks))
    try:
        with progress:
            lost = run_in_cells(tasks, pool, results.__setitem__, progress)
    finally:
        pool.close()
    if lost:
        first = next(iter(lost))
        raise CrosspihError(
            f"{len(lost)} of {len(tasks)} could not be done; the first, {tasks[first].label}: {lost[first]}"
        )
    return [results[index] for index in range(len(tasks))]


def _trials(
    console: Console, title: str, content: dict[str, Any], seeds: range, strategy: Strategy, cells: int | None,
    record: bool = False,
) -> list[TrialFigures]:  # fmt: skip
    jobs = [TrialJob(seed=seed, strategy=strategy) for seed in seeds]
    tasks = [trial_task(job, content, record) for job in jobs]
    return [TrialFigures.model_validate(found) for found in _done(console, title, tasks, cells)]


def compared_table(before: BenchResult, after: BenchResult) -> Table:
    """The figures of the same seeds, p50 / p95, before and after."""
    table = Table(title=f"seeds from {before.seed}, p50 / p95 (mean)")
    table.add_column("")
    for name in ("as drawn", "refined"):
        table.add_column(name, justify="right")
    table.add_row("inserted", *(f"{one.inserted} of {one.trials}" for one in (before, after)))
    table.add_row("vision refused, felt for", before.sight.short, after.sight.short)
    for name, title in ROWS:
        table.add_row(title, *(_figure(one, name) for one in (before, after)))
    return table


def _figure(result: BenchResult, name: str) -> str:
    values = [value for one in result.each if (value := getattr(one, name)) is not None]
    if not values:
        return ""
    mean = sum(abs(value) for value in values) / len(values)
    known = result.figures.get(name)
    spread = "" if known is None else f"{known.p50:.3f} / {known.p95:.3f} "
    return f"{spread}({mean:.3f})"


def refine(
    trials: Annotated[int, typer.Option(min=2, help="How many seeds are recorded, and how many compared.")] = 30,
    seed: Annotated[int, typer.Option(min=0, help="The first seed; those compared come after those recorded.")] = 1000,
    felt: Annotated[int, typer.Option(min=0, help="Further seeds recorded with vision off, which touch.")] = 10,
    strategy: Annotated[Strategy, typer.Option(help="How to get the peg in.")] = Strategy.FUSED,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="More that differs: hardware.simulated.truth.camera_shift_m=...")
    ] = None,
    out: Annotated[Path, typer.Option(help="Where the refined cell's file goes.")] = Path("run/refined.yaml"),
    recordings: Annotated[Path, typer.Option(help="Where the recordings go.")] = Path("run/refine-recordings"),
    cells: Cells = None,
    as_json: AsJson = False,
) -> None:
    """Assemble in a cell with unmodelled errors, refine over its recordings, and assemble the next seeds with both."""
    console = Console(stderr=True)
    with errors_shown(console):
        truth = Condition(overrides={"hardware": {"simulated": {"truth": UNMODELLED}}})
        require_settings(settings or ())
        drawn = merged(cell_content(base_cell_text(), truth, DEFAULT_PEG), condition_of(settings or ()).overrides)
        recorded = merged(drawn, {"recorder": {"directory": str(recordings.resolve())}})
        blind = merged(recorded, {"vision": {"enabled": False}})
        calibration = CellTask(
            "calibration", recorded, recorded_calibration,
            {"name": "calibration", "dwell_s": CALIBRATION_DWELL_S}, (*NEEDED, "recorder"), calibrate=False,
        )  # fmt: skip
        paths = [Path(str(path)) for path in _done(console, "calibration", [calibration], 1)]
        past = _trials(console, "recorded", recorded, range(seed, seed + trials), strategy, cells, True)
        if felt:
            past += _trials(console, "felt", blind, range(seed, seed + felt), strategy, cells, True)
        paths += [Path(one.recording) for one in past if one.recording is not None]
        with tempfile.TemporaryDirectory(prefix="crosspih-refine-") as folder:
            given = Path(folder) / "cell.yaml"
            given.write_text(yaml.safe_dump(drawn, sort_keys=False), encoding="utf-8")
            result = run_refine(paths, given, console)
        refined = write_cell(out, drawn, result, "a cell with unmodelled errors")
        after = range(seed + trials, seed + 2 * trials)
        first = summarise(strategy.value, after.start, _trials(console, "as drawn", drawn, after, strategy, cells))
        second = summarise(strategy.value, after.start, _trials(console, "refined", refined, after, strategy, cells))
        if as_json:
            json.dump({"refinement": result, "before": first.model_dump(), "after": second.model_dump()}, sys.stdout)
            print()
            return
        shown = Console()
        shown.print(refined_table(result))
        for line in [*residual_lines(result), *result["notes"]]:
            shown.print(line, highlight=False, markup=False)
        shown.print(compared_table(first, second))
        shown.print(f"cell: {out}", highlight=False)
