"""`crosspih bench vision`: vision's pose of the hole, over seeds and over faults in front of the cameras."""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from pydantic import BaseModel, ConfigDict
from rich.console import Console
from rich.table import Table
from scipy.special import chdtri

from crosspih_common.errors import CommandRefused, CrosspihError
from crosspih_common.keys import LOCATE
from crosspih_common.messages import LocateHole, ResetCell, SceneFaults
from services.operator.assembly.session import Session
from services.operator.assembly.stack import cell_session
from services.operator.bench.cells.bar import Bar
from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.pictures.judging.table import table_of
from services.operator.bench.pictures.running import bench_pictures
from services.operator.cli.failure import Failed, failure_of
from services.operator.scoring.score import pose_error
from services.operator.scoring.statistics import wilson95

LOCATE_DEADLINE_S = 60.0
# beyond this the taper would not catch the peg any more
MAX_LATERAL_MM, MAX_DEPTH_MM, MAX_TILT_DEG = 1.0, 3.0, 3.0

FAULTS: dict[str, SceneFaults] = {
    "light x 0.05": SceneFaults(light_scale=0.05),
    "light x 0.3": SceneFaults(light_scale=0.3),
    "light x 2": SceneFaults(light_scale=2.0),
    "glare, 80 grey": SceneFaults(glare=80.0),
    "glare, 150 grey": SceneFaults(glare=150.0),
    "+x arm covered": SceneFaults(covered_arm=0),
    "+y arm covered": SceneFaults(covered_arm=1),
    "no hole": SceneFaults(hole=False),
    "square, no hole": SceneFaults(hole=False, square=True),
    "second cross": SceneFaults(second_cross=True),
    "pictures swapped": SceneFaults(swapped=True),
    "right camera off by 0.7 rows": SceneFaults(right_rows_px=0.7),
}


class VisionTrial(BaseModel):
    """One picture pair: vision's answer, against the truth.

    `beyond_limits`: a pose with so large an error that the taper would not catch the peg; `confidently_wrong`: one
    outside its own 99.99 % region, or given where there is no hole.
    """

    model_config = ConfigDict(frozen=True)

    seed: int
    refusal: str | None
    lateral_mm: float | None = None
    depth_mm: float | None = None
    tilt_deg: float | None = None
    rotation_deg: float | None = None
    nees: float | None = None
    looks: int = 1
    beyond_limits: bool = False
    confidently_wrong: bool = False


class SightSummary(BaseModel):
    """All picture pairs of one condition; quantiles are (p50, p95) of the accepted ones."""

    model_config = ConfigDict(frozen=True)

    condition: str
    pairs: int
    accepted: int
    second_looks: int
    beyond_limits: int
    confidently_wrong: int
    refusals: dict[str, int]
    lateral_mm: tuple[float, float] | None
    depth_mm: tuple[float, float] | None
    tilt_deg: tuple[float, float] | None
    in_95_region: float | None
    in_95_region_wilson95: tuple[float, float] | None
    each: list[VisionTrial]


def see(session: Session, seed: int, scene: SceneFaults | None) -> VisionTrial:
    """A new trial's hole, and vision's pose of it."""
    truth = session.new_trial(ResetCell(seed=seed, scene=scene))
    try:
        seen = session.bus.call(LOCATE, LocateHole(), LOCATE_DEADLINE_S)
    except CommandRefused as refusal:
        return VisionTrial(seed=seed, refusal=refusal.code)
    true_base_hole = truth.pose_base_hole.pose()
    found = seen.pose_base_hole.pose()
    error = pose_error(found, true_base_hole)
    off = found.inverse() @ true_base_hole
    xi = np.concatenate([off.translation_m, off.rotvec_rad()])
    nees = float(xi @ np.linalg.solve(np.asarray(seen.covariance).reshape(6, 6), xi))
    far = error.lateral_mm > MAX_LATERAL_MM or abs(error.depth_mm) > MAX_DEPTH_MM or error.tilt_deg > MAX_TILT_DEG
    no_hole = scene is not None and not scene.hole
    return VisionTrial(
        seed=seed,
        refusal=None,
        lateral_mm=error.lateral_mm,
        depth_mm=error.depth_mm,
        tilt_deg=error.tilt_deg,
        rotation_deg=error.rotation_deg,
        nees=nees,
        looks=int(seen.diagnostics.get("looks", 1.0)),
        beyond_limits=far and not no_hole,
        confidently_wrong=no_hole or nees > chdtri(6, 1e-4),
    )


def summarise_sights(condition: str, sights: list[VisionTrial]) -> SightSummary:
    """Counts and quantiles."""
    accepted = [sight for sight in sights if sight.refusal is None]

    def quantiles(name: str) -> tuple[float, float] | None:
        values = np.abs([getattr(sight, name) for sight in accepted])
        return (float(np.median(values)), float(np.percentile(values, 95))) if len(values) else None

    inside = sum(sight.nees is not None and bool(sight.nees < chdtri(6, 0.05)) for sight in accepted)
    return SightSummary(
        condition=condition,
        pairs=len(sights),
        accepted=len(accepted),
        second_looks=sum(sight.looks > 1 for sight in accepted),
        beyond_limits=sum(sight.beyond_limits for sight in sights),
        confidently_wrong=sum(sight.confidently_wrong for sight in sights),
        refusals=dict(Counter(sight.refusal for sight in sights if sight.refusal is not None)),
        lateral_mm=quantiles("lateral_mm"),
        depth_mm=quantiles("depth_mm"),
        tilt_deg=quantiles("tilt_deg"),
        in_95_region=inside / len(accepted) if accepted else None,
        in_95_region_wilson95=wilson95(inside, len(accepted)) if accepted else None,
        each=sights,
    )


def _table(rows: list[SightSummary]) -> Table:
    wrong, asked = sum(row.confidently_wrong for row in rows[1:]), sum(row.pairs for row in rows[1:])
    table = Table(
        title="vision against the truth, p50 / p95 of the poses given",
        caption=f"far off: by more than {MAX_LATERAL_MM:g} mm across, {MAX_DEPTH_MM:g} mm along or {MAX_TILT_DEG:g}°; "
        f"confidently wrong: outside its own 99.99 % region, or given where no hole is; all faults together: "
        f"{wrong} confidently wrong in {asked} pairs",
    )
    for name in ("condition", "pairs", "given", "by a second light", "lateral mm", "depth mm", "tilt °"):
        table.add_column(name, justify="left" if name == "condition" else "right")
    for name in ("in its 95 % region", "far off", "confidently wrong", "refused"):
        table.add_column(name)

    def pair(values: tuple[float, float] | None) -> str:
        return "" if values is None else f"{values[0]:.3f} / {values[1]:.3f}"

    for row in rows:
        region = ""
        if row.in_95_region is not None and row.in_95_region_wilson95 is not None:
            low, high = row.in_95_region_wilson95
            region = f"{row.in_95_region:.1%} ({low:.0%}-{high:.0%})"
        table.add_row(
            row.condition,
            str(row.pairs),
            str(row.accepted),
            str(row.second_looks),
            pair(row.lateral_mm),
            pair(row.depth_mm),
            pair(row.tilt_deg),
            region,
            str(row.beyond_limits),
            f"[red]{row.confidently_wrong}[/red]" if row.confidently_wrong else "0",
            ", ".join(f"{name} {count}" for name, count in row.refusals.items()),
        )
    return table


def vision(
    poses: Annotated[int, typer.Option(min=1, help="How many sound picture pairs.")] = 400,
    faults: Annotated[int, typer.Option(min=0, help="How many pairs of each fault.")] = 25,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1000,
    pictures: Annotated[
        str | None, typer.Option(help="Pairs with truth instead of the cell's own: rendered, or a folder of them.")
    ] = None,
    rows: Annotated[str | None, typer.Option(help="Of --pictures: only these rows, with commas.")] = None,
    pairs: Annotated[int | None, typer.Option(min=1, help="Of --pictures: at most this many per row.")] = None,
    annotated: Annotated[Path | None, typer.Option(help="Of --pictures: a folder for the annotated pictures.")] = None,
    beside: Annotated[
        bool, typer.Option("--beside/--alone", help="Of --pictures: ask solvePnP and the paper's method too.")
    ] = True,
    report: Annotated[Path | None, typer.Option(help="Of --pictures: the JSON object into a file as well.")] = None,
    as_json: AsJson = False,
) -> None:
    """Locate the hole over seeds, and with each fault in front of the cameras; print errors, refusals, wrong poses.

    With --pictures: in pictures of another renderer, or of yours, with their truth (docs/vision-pictures.md).
    """
    console = Console(stderr=True)
    if pictures is not None:
        with errors_shown(console):
            judged = bench_pictures(pictures, rows, pairs, annotated, beside, console)
            if report is not None:
                report.write_text(judged.model_dump_json(indent=1), encoding="utf-8")
            if as_json:
                print(judged.model_dump_json(indent=1))
            else:
                Console().print(table_of(judged))
        return
    wanted: list[tuple[str, SceneFaults | None, int]] = [("sound", None, poses)]
    wanted += [(name, scene, faults) for name, scene in FAULTS.items() if faults]
    summaries: list[SightSummary] = []
    name, sights = "sound", list[VisionTrial]()
    ended: CrosspihError | None = None
    try:
        with (
            cell_session("max", ("hardware", "vision")) as (session, _),
            Bar(console) as progress,
        ):
            task = progress.add_task("sound", total=sum(count for _, _, count in wanted))
            for name, scene, count in wanted:
                progress.update(task, description=name)
                sights = []
                for index in range(count):
                    sights.append(see(session, seed + index, scene))
                    progress.advance(task)
                summaries.append(summarise_sights(name, sights))
    except CrosspihError as error:
        # the results up to then are still reported
        ended = error
        if sights and not any(row.condition == name for row in summaries):
            summaries.append(summarise_sights(name, sights))
    if as_json and (summaries or ended is None):
        json.dump([row.model_dump() for row in summaries], sys.stdout, indent=1)
        print()
    elif summaries:
        Console().print(_table(summaries))
    if ended is not None:
        console.print(f"bench ended early: {ended}", style="red", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) if summaries else Failed(failure_of(ended))
