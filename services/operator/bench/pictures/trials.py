"""Trials whose cameras show another renderer's pictures: the scene's hole lies where the simulated cell puts it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path

import cv2
import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.errors import CrosspihError
from services.operator.bench.cells.conditions import Condition, merged
from services.operator.bench.cells.trials import TrialJob
from services.operator.bench.pictures.kept.shots import Picture, Shot, WantedShot, wanted_from
from services.operator.bench.pictures.scenes.scene import drawn_pose

ROWS = ("matt", "metal_soft", "metal_hard", "lamp", "black", "bright", "through", "blind")
SHOWN = Path("results/pictures/shown")


def with_pictures(jobs: list[TrialJob], folder: Path, rows: list[str] | None, shown: Path = SHOWN) -> list[TrialJob]:
    """As many of the jobs as the folder has scenes of the default cell's hole, each with a scene's seed and pair.

    The pairs are written below `shown`, named by what they show. Raises CrosspihError where there are fewer scenes.
    """
    shown.mkdir(parents=True, exist_ok=True)
    result: list[TrialJob] = []
    for job, shot in zip(jobs, _scenes(folder, rows), strict=False):
        pair = {side: [_written(picture, shown)] for side, picture in (("left", shot.left), ("right", shot.right))}
        text = json.dumps(shot.calibration, indent=1)
        calibration = shown.resolve() / f"{_digest(text.encode())}.json"
        calibration.write_text(text, encoding="utf-8")
        overrides = {
            "hardware": {
                "drivers": {"camera": "pictures"}, "pictures": {**pair, "calibration": str(calibration)},
            }
        }  # fmt: skip
        condition = Condition(
            name=f"{job.condition.name}, {shot.name}", overrides=merged(job.condition.overrides, overrides)
        )
        result.append(job.model_copy(update={"seed": int(shot.about["seed"]), "condition": condition}))
    if len(result) < len(jobs):
        raise CrosspihError(
            f"--pictures: {folder} has {len(result)} scenes for the default cell, {len(jobs)} trials are asked for; "
            f"ask for fewer, or make more: crosspih bench pictures --out {folder}"
        )
    return result


def _scenes(folder: Path, rows: list[str] | None) -> Iterator[Shot]:
    """A pair of each scene that has the default cell's hole and cameras, the rows in turn."""
    there = {one.row for one in wanted_from(folder, None, None)}
    named = [row for row in ROWS if row in there] if rows is None else rows
    by_row = [wanted_from(folder, [row], None) for row in named]
    seen: set[int] = set()
    for turn in zip_longest(*by_row):
        for wanted in turn:
            shot = _of_the_cell(wanted)
            if shot is not None and int(shot.about["seed"]) not in seen:
                seen.add(int(shot.about["seed"]))
                yield shot


def _of_the_cell(wanted: WantedShot | None) -> Shot | None:
    """The pair, where the trial of its seed has the hole at the same place."""
    shot = None if wanted is None else wanted.load()
    if shot is None or shot.pose_base_hole is None or shot.peg is not None or "seed" not in shot.about:
        return None
    drawn = drawn_pose(Workcell(), int(shot.about["seed"]))
    return shot if np.allclose(drawn.matrix(), shot.pose_base_hole.matrix(), atol=1e-9) else None


def _written(picture: Picture, shown: Path) -> str:
    data = cv2.imencode(".png", picture)[1].tobytes()
    path = shown.resolve() / f"{_digest(data)}.png"
    path.write_bytes(data)
    return str(path)


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
