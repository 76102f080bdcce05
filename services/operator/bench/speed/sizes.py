"""`crosspih bench sizes`: how long vision takes for a pair of pictures, by their size."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict
from rich.table import Table

from crosspih_common.config import CameraSection
from crosspih_common.errors import CommandRefused
from crosspih_common.keys import LOCATE
from crosspih_common.messages import LocateHole, ResetCell
from services.operator.assembly.session import Session
from services.operator.scoring.score import pose_error

SIZES = ((320, 240), (640, 480), (1280, 960), (1920, 1440), (2448, 2048))
LOCATE_DEADLINE_S = 300.0


class SizeRow(BaseModel):
    """One size: wall times of the located pairs, without taking the pictures, and the errors of the poses."""

    model_config = ConfigDict(frozen=True)

    width_px: int
    height_px: int
    pairs: int
    located: int
    p50_s: float | None
    p95_s: float | None
    lateral_p50_mm: float | None
    refusals: dict[str, int]


class SizesResult(BaseModel):
    """What `crosspih bench sizes --json` prints."""

    model_config = ConfigDict(frozen=True)

    rows: list[SizeRow]


def content_at(content: dict[str, Any], camera: CameraSection, width_px: int, height_px: int) -> dict[str, Any]:
    """The cell's file with cameras of that size: the same horizontal angle of view, and the same optical axis."""
    factor = width_px / camera.width_px
    focal_px = camera.fx_px * factor
    section = {
        **dict((content.get("cell") or {}).get("camera") or {}),
        "width_px": width_px, "height_px": height_px,
        "fx_px": focal_px, "fy_px": focal_px * camera.fy_px / camera.fx_px,
        "cx_px": (camera.cx_px + 0.5) * factor - 0.5,
        "cy_px": (camera.cy_px + 0.5) * height_px / camera.height_px - 0.5,
    }  # fmt: skip
    return {**content, "cell": {**(content.get("cell") or {}), "camera": section}}


def row_of(session: Session, size_and_seeds: tuple[int, int, range]) -> SizeRow:
    """Locate the holes of some seeds and time it; one before them does not count."""
    width_px, height_px, seeds = size_and_seeds
    times_s: list[float] = []
    lateral_mm: list[float] = []
    refusals: dict[str, int] = {}
    for seed in (seeds.start, *seeds):
        truth = session.new_trial(ResetCell(seed=seed))
        started = time.perf_counter()
        try:
            seen = session.bus.call(LOCATE, LocateHole(), LOCATE_DEADLINE_S)
        except CommandRefused as refusal:
            refusals[refusal.code] = refusals.get(refusal.code, 0) + 1
            continue
        times_s.append(time.perf_counter() - started - seen.capture_wall_s)
        lateral_mm.append(pose_error(seen.pose_base_hole.pose(), truth.pose_base_hole.pose()).lateral_mm)
    # the first pair includes the time of everything that is loaded once
    times_s, lateral_mm = times_s[1:], lateral_mm[1:]
    return SizeRow(
        width_px=width_px, height_px=height_px, pairs=len(seeds), located=len(times_s),
        p50_s=float(np.median(times_s)) if times_s else None,
        p95_s=float(np.percentile(times_s, 95)) if times_s else None,
        lateral_p50_mm=float(np.median(lateral_mm)) if lateral_mm else None, refusals=refusals,
    )  # fmt: skip


def table_of(result: SizesResult) -> Table:
    """One row per size."""
    table = Table(title="vision alone, wall time a pair of pictures")
    for column in ("size", "pairs", "located", "p50 ms", "p95 ms", "lateral p50 mm", "refused"):
        table.add_column(column, justify="left" if column in ("size", "refused") else "right")

    def number(value: float | None, factor: float, digits: int) -> str:
        return "" if value is None else f"{value * factor:.{digits}f}"

    for row in result.rows:
        table.add_row(
            f"{row.width_px} x {row.height_px}", str(row.pairs), str(row.located), number(row.p50_s, 1e3, 0),
            number(row.p95_s, 1e3, 0), number(row.lateral_p50_mm, 1.0, 3),
            ", ".join(f"{code} {count}" for code, count in row.refusals.items()),
        )  # fmt: skip
    return table
