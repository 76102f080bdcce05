"""`crosspih dataset collect`: contacts over the bus, in as many cells as wanted, resumable."""

from __future__ import annotations

import hashlib
import json
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.datasets import CONTACT, ContactRow, ContactWriter, DatasetError, DatasetOrigin, read_contacts
from crosspih_common.plain_yaml import yaml_of
from crosspih_common.provenance import cell_identity, code_version
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import base_cell_text
from services.operator.bench.options import Cells, RayAddress, Where, errors_shown
from services.operator.dataset.commands.describe import summary
from services.operator.dataset.contact import REPEAT_STRIDE, make_contacts

# the size of a task: a stopped run loses at most this many samples a cell
SAMPLES_A_TASK = 10
MADE_BY = ("services.operator.dataset.contact",)  # sources that count besides the cell's own code
SERVICES = ("hardware", "force_torque", "planning")

Poses = Annotated[int, typer.Option(min=1, max=REPEAT_STRIDE, help="Pose errors to draw, one contact each.")]
FirstSeed = Annotated[int, typer.Option("--seed", min=0, help="The first pose's seed.")]
AngleRad = Annotated[float, typer.Option(min=0.0, max=0.3, help="Half range of each error angle.")]
LateralM = Annotated[float, typer.Option(min=0.0, max=0.02, help="Half range of x and y at the rim.")]


def cell_sha256(content: dict[str, Any]) -> str:
    """A hash of everything in a cell's file that determines a contact, with the content of files named there; the
    cell's name does not count.
    """
    text = json.dumps(cell_identity(content), sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def version() -> str:
    """The installed crosspih's version; empty from a bare source tree."""
    try:
        return metadata.version("crosspih")
    except metadata.PackageNotFoundError:
        return ""


def collect(
    poses: Poses = 600,
    repeats: Annotated[int, typer.Option(min=1, max=1000, help="Contacts at each pose, each with new noise.")] = 1,
    seed: FirstSeed = 1,
    out: Annotated[Path, typer.Option(help="The data set's folder; samples in it are not made again.")] = Path(
        "run/contacts"
    ),
    angle_rad: AngleRad = 0.1,
    lateral_m: LateralM = 0.001,
    move_aside: Annotated[
        bool,
        typer.Option("--move-aside", help="What is there and was made otherwise or by other code is renamed."),
    ] = False,
    threshold_n: Annotated[float, typer.Option(min=1.0, help="Force at which a contact is read.")] = 15.0,
    cells: Cells = None,
    executor: Where = ExecutorName.LOCAL,
    ray_address: RayAddress = None,
) -> None:
    """Push the peg against the hole at drawn pose errors and keep what is felt, each sample with its pose, state, seed.

    Everything goes over the bus, in cells of its own. A sample does not depend on the cell that made it.
    """
    console = Console(stderr=True)
    with errors_shown(console):
        content = cell_content(base_cell_text(), Condition())
        settings = {"angle_rad": angle_rad, "lateral_m": lateral_m, "threshold_n": threshold_n}
        shown = " ".join(f"--{name.replace('_', '-')} {value:g}" for name, value in settings.items())
        origin = DatasetOrigin(
            made_by="cell",
            command=f"crosspih dataset collect --poses {poses} --repeats {repeats} --seed {seed} {shown}",
            first_seed=seed,
            poses=poses,
            repeats=repeats,
            cell_sha256=cell_sha256(content),
            settings=settings,
            code=code_version(*MADE_BY),
            version=version(),
        )
        with _opened(out, origin, move_aside, console) as writer:
            _collect(console, writer, content, cells, executor, ray_address)
    Console().print(summary(out, read_contacts(out)))


def _opened(out: Path, origin: DatasetOrigin, move_aside: bool, console: Console) -> ContactWriter:
    """The folder to continue; with `move_aside` a folder made with other settings is renamed to a free
    name beside it.
    """
    try:
        return ContactWriter(out, origin)
    except DatasetError as error:
        if not move_aside:
            raise
        number = 1
        while (aside := out.with_name(f"{out.name}-before-{number}")).exists():
            number += 1
        out.rename(aside)
        console.print(f"moved to {aside}: {error}", style="yellow", highlight=False, soft_wrap=True)
        return ContactWriter(out, origin)


def _collect(
    console: Console,
    writer: ContactWriter,
    content: dict[str, Any],
    cells: int | None,
    executor: ExecutorName,
    ray_address: str | None,
) -> None:
    """Collect the missing samples of the data set, in cells side by side."""
    origin = writer.origin
    wanted = [
        (pose_seed, repeat)
        for repeat in range(origin.repeats)
        for pose_seed in range(origin.first_seed, origin.first_seed + origin.poses)
    ]
    left = [(pose, repeat) for pose, repeat in wanted if pose + repeat * REPEAT_STRIDE not in writer.done]
    progress = CellsProgress(console, "tens of contacts")
    parts = [left[start : start + SAMPLES_A_TASK] for start in range(0, len(left), SAMPLES_A_TASK)]
    if len(left) < len(wanted):
        there = len(wanted) - len(left)
        progress.say(f"{there} of {len(wanted)} contacts are there already, made by this code ({origin.code})")
    if not parts:
        return
    progress.taken_over(len(parts), 0)
    tasks = [
        CellTask(
            f"contacts from seed {part[0][0]}", content, make_contacts, {**origin.settings, "samples": part}, SERVICES
        )
        for part in parts
    ]

    def keep(index: int, rows: Any) -> None:
        contacts = [ContactRow.model_validate(row) for row in rows]
        writer.put(contacts)
        for row in contacts:
            if row.outcome != CONTACT:
                progress.say(f"seed {row.seed}: {row.outcome}", "yellow")

    pool = open_executor(executor, cells, len(tasks), ray_address)
    try:
        with progress:
            lost = run_in_cells(tasks, pool, keep, progress)
    finally:
        pool.close()
    if lost:
        progress.say(f"{len(lost)} tasks were lost, each tried twice; the same command tries them again", "red")


def default_cell_sha256() -> str:
    """The identity of the cell that commands use now."""
    return cell_sha256(yaml_of(base_cell_text()) or {})
