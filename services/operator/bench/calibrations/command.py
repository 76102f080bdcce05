"""`crosspih bench calibrations`: simulated cells that differ from their files; each calibration against the truth.

A trial draws the hidden errors by its seed, and takes pictures of the board (or pushes on the plate) once; every
calibration then uses these. With `--keep` they are kept, and `--from` evaluates them again with today's code.
"""

from __future__ import annotations

import io
import json
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import yaml
from rich.console import Console
from rich.table import Table

from crosspih_common.config import Workcell
from crosspih_common.config.cell import cell_of_text
from crosspih_common.errors import ConfigError, CrosspihError
from crosspih_common.messages import ResetCell
from crosspih_common.provenance import cell_identity, code_version, result_key
from services.operator.assembly.session import Session
from services.operator.bench.calibrations.scored import WANTED, hidden, pictures_scored, pushes_scored
from services.operator.bench.cells.conditions import cell_content, condition_of, merged
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import base_cell_text
from services.operator.bench.options import AsJson, Cells, errors_shown
from services.operator.calibrate.folder import PRESSED, read_pressed, read_taken, write_yaml
from services.operator.calibrate.pressing import PressingManner, take_presses
from services.operator.calibrate.taking import VISION, take_by_arm
from services.operator.cell.settings import require_settings
from services.operator.config import OperatorConfig
from services.operator.locate.worker import OfflineVision

PICTURES, PUSHES = "pictures", "pushes"
ABOUT = "about.json"
# the code that takes pictures and pushes, besides the cell's own code
MADE_BY = ("services.operator.calibrate", "services.operator.bench.calibrations")
NEEDED = {PICTURES: ("hardware",), PUSHES: ("hardware", "force_torque", "planning")}


def pictures_trial(session: Session, payload: dict[str, Any]) -> list[dict[str, Any]]:
    """Stereo, and hand-eye with its cameras, against the truth. For a worker."""
    seed = payload["seed"]
    session.new_trial(ResetCell(seed=seed))
    section = session.cell.section("operator", OperatorConfig).board
    assert section is not None
    with ExitStack() as stack:
        folder = _kept(payload) or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="crosspih-pictures-")))
        vision = stack.enter_context(OfflineVision(VISION))
        quiet = Console(file=io.StringIO())
        taken = take_by_arm(session, vision, section, payload["pairs"], folder, quiet, 1.0, "bench", seed)
        rows = pictures_scored(taken, folder, vision, session.cell.workcell, payload["truth"])
    return rows


def pushes_trial(session: Session, payload: dict[str, Any]) -> list[dict[str, Any]]:
    """Tip, mounting and stiffness, each with the result of the one before, against the truth. For a worker."""
    session.new_trial(ResetCell(seed=payload["seed"]))
    manner = PressingManner(payload["presses"], payload["force_n"], payload["seed"])
    pressed = take_presses(session, Console(file=io.StringIO()), manner, 1.0, "bench", weighed=True)
    folder = _kept(payload)
    if folder is not None:
        write_yaml(folder / PRESSED, pressed.model_dump(mode="json"))
    return pushes_scored(pressed, session.cell, payload["content"], payload["truth"])


def _kept(payload: dict[str, Any]) -> Path | None:
    """The folder of what was taken, created."""
    if payload["keep"] is None:
        return None
    folder = Path(payload["keep"])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ABOUT).write_text(json.dumps(taken_with(payload) | {"code": code_version(*MADE_BY)}), encoding="utf-8")
    return folder


def taken_with(payload: dict[str, Any]) -> dict[str, Any]:
    """The settings that determine what a trial takes, except for the code."""
    names = ("seed", "pairs") if payload["what"] == PICTURES else ("seed", "presses", "force_n")
    return {**{name: payload[name] for name in names}, "cell": result_key(cell_identity(payload["content"]))}


def check_kept(folder: Path, payload: dict[str, Any], console: Console) -> None:
    """Check that a folder holds data taken with these settings, and by which code. Raises ConfigError for other
    settings.
    """
    about = folder / ABOUT
    if not about.is_file():
        console.print(f"{folder}: does not say with what settings it was taken", style="yellow", highlight=False)
        return
    there, wanted = json.loads(about.read_text(encoding="utf-8")), taken_with(payload)
    if differ := [name for name, value in wanted.items() if there.get(name) != value]:
        said = ", ".join(f"{name} {there.get(name)}, not {wanted[name]}" for name in differ)
        raise ConfigError(f"--from: {folder} was taken with {said}; give the settings that --keep had")
    if there.get("code") != (code := code_version(*MADE_BY)):
        said = f"{folder}: taken by code {there.get('code')}, worked on by {code}"
        console.print(said, style="yellow", highlight=False, soft_wrap=True)


def check_free(folder: Path) -> None:
    """Check that the folders for the trials are empty. Raises ConfigError."""
    if folder.is_dir() and any(folder.iterdir()):
        raise ConfigError(f"--keep: {folder} holds another trial; name another folder, or look at that one by --from")


def scored_again(what: str, folder: Path, payload: dict[str, Any]) -> list[dict[str, Any]]:
    """Evaluate the data of `--keep` again, without a cell. Raises ConfigError, CalibrationRefused."""
    cell = cell_of_text(folder / "cell.yaml", yaml.safe_dump(payload["content"]))
    if what == PUSHES:
        return pushes_scored(read_pressed(folder), cell, payload["content"], payload["truth"])
    taken, pictures = read_taken([folder], None)
    with OfflineVision(VISION) as vision:
        return pictures_scored(taken, pictures, vision, cell.workcell, payload["truth"])


def table_of(found: dict[str, list[dict[str, Any]]]) -> Table:
    """One row per calibration: the worst and the median error over all trials, and how often the
    interval contained it.
    """
    table = Table(title="calibrations against what the simulated cells hide")
    for heading in ("", "trials", "error p50", "largest", "asked", "± 95 % p50", "inside", ""):
        table.add_column(heading, justify="left" if not heading else "right")
    for name, rows in found.items():
        if "open" in rows[0]:
            said = sorted({joint for row in rows for joint in row["open"]})
            table.add_row(name, str(len(rows)), ", ".join(map(str, said)) or "none", "", "", "", "", "")
            continue
        off = np.abs([value for row in rows for value in row["off"]])
        half = [value for row in rows for value in row["half_95"]]
        inside = [one for row in rows for one in row["inside"]]
        # a position and a rotation are judged by their length
        whole = [float(np.linalg.norm(row["off"])) if name in WANTED and name != "stiffness" else max(
            (abs(value) for value in row["off"]), default=0.0) for row in rows]  # fmt: skip
        asked = f"{WANTED[name]:g}" if name in WANTED else ""
        table.add_row(
            name, str(len(rows)), f"{np.median(off):.4f}", f"{max(whole):.4f}", asked, f"{np.median(half):.4f}",
            f"{sum(inside)} of {len(inside)}", rows[0]["unit"],
        )  # fmt: skip
    return table


def _in_cells(
    tasks: list[CellTask], results: dict[int, list[dict[str, Any]]], cells: int | None, console: Console
) -> dict[int, str]:
    """The lost trials by index, with the reason of each."""
    progress = CellsProgress(console, "calibrations")
    progress.taken_over(len(tasks), 0)
    pool = open_executor(ExecutorName.LOCAL, cells, len(tasks))
    try:
        with progress:
            return run_in_cells(tasks, pool, results.__setitem__, progress)
    finally:
        pool.close()


def calibrations(
    trials: Annotated[int, typer.Option(min=1, help="Cells, each with hidden errors of its own.")] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Of the first.")] = 1,
    pairs: Annotated[int, typer.Option(min=6, help="Pictures of the board in each.")] = 20,
    presses: Annotated[int, typer.Option(min=7, help="Pushes in each.")] = 16,
    force_n: Annotated[float, typer.Option(min=4.0, max=40.0, help="The hardest push, N.")] = 18.0,
    what: Annotated[str, typer.Option(help="pictures, pushes, or both with a comma between.")] = "pictures,pushes",
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="More that differs: hardware.engine=mujoco")
    ] = None,
    keep: Annotated[Path | None, typer.Option(help="A folder for what each trial takes.")] = None,
    kept: Annotated[
        Path | None, typer.Option("--from", help="What --keep kept, with the same seeds and settings: no cell is run.")
    ] = None,
    cells: Cells = None,
    as_json: AsJson = False,
) -> None:
    """What stereo, hand-eye, tcp, mount and stiffness find, against what simulated cells hide from the services."""
    console = Console(stderr=True)
    with errors_shown(console):
        require_settings(settings or ())
        base = cell_content(base_cell_text(), condition_of(settings or ()))
        joints = Workcell.model_validate(base.get("cell") or {}).arm().joints
        tasks = []
        for number in range(seed, seed + trials):
            differs = hidden(number, joints)
            content = merged(base, differs)
            for kind, work in ((PICTURES, pictures_trial), (PUSHES, pushes_trial)):
                if kind not in what:
                    continue
                root = kept or keep
                payload = {
                    "what": kind, "seed": number, "content": content,
                    "truth": differs["hardware"]["simulated"]["truth"],
                    "pairs": pairs, "presses": presses, "force_n": force_n,
                    "keep": None if root is None else str(root.resolve() / f"{kind}-{number}"),
                }  # fmt: skip
                tasks.append(CellTask(f"{kind} {number}", content, work, payload, NEEDED[kind], kind == PUSHES))
                if kept is not None:
                    check_kept(Path(payload["keep"]), payload, console)
                elif keep is not None:
                    check_free(Path(payload["keep"]))
        results: dict[int, list[dict[str, Any]]] = {}
        if kept is not None:
            lost = {}
            for index, task in enumerate(tasks):
                results[index] = scored_again(task.label.split()[0], Path(task.payload["keep"]), task.payload)
        else:
            lost = _in_cells(tasks, results, cells, console)
        for index, why in lost.items():
            console.print(f"{tasks[index].label}: {why}", style="red", highlight=False, markup=False, soft_wrap=True)
        if not results:
            raise CrosspihError("no trial came to an end")
        found: dict[str, list[dict[str, Any]]] = {}
        for index in sorted(results):
            for row in results[index]:
                found.setdefault(row["name"], []).append({**row, "trial": tasks[index].label})
        if as_json:
            json.dump(
                {"found": found, "lost": {tasks[index].label: str(why) for index, why in lost.items()}}, sys.stdout
            )
            print()
        else:
            Console().print(table_of(found))
        if lost:
            raise typer.Exit(1)
