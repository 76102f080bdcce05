"""What vision said of pairs of pictures against their truth. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy.special import chdtri

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.operator.scoring.statistics import wilson95

# quantiles of chi2 with six degrees of freedom
IN_95, IN_9999 = float(chdtri(6, 0.05)), float(chdtri(6, 0.0001))
Span = tuple[float, float]
RENDERED_BY = "rendered_by"  # in a scene's truth: the code that made its light


class PictureVerdict(BaseModel):
    """One pair: what was answered. `nees` is the error against the stated covariance, squared."""

    model_config = ConfigDict(frozen=True)

    name: str
    row: str
    is_the_hole: bool
    located: bool
    refusal: str | None = None
    text: str | None = None
    lateral_mm: float | None = None
    depth_mm: float | None = None
    tilt_deg: float | None = None
    roll_deg: float | None = None
    nees: float | None = None
    time_s: float | None = None
    quality: dict[str, float] = {}
    rendered_by: str = ""
    plain_located: bool = False
    plain_lateral_mm: float | None = None
    paper_located: bool = False
    paper_lateral_mm: float | None = None

    @property
    def wrong(self) -> bool:
        """Sure and wrong: a pose where there is no such hole, or one outside its own 99.99 % region."""
        return self.located and (not self.is_the_hole or self.nees is None or not self.nees <= IN_9999)


class RowFigures(BaseModel):
    """All pairs of a row; spans are (p50, p95) of the located ones that show the hole."""

    model_config = ConfigDict(frozen=True)

    row: str
    pairs: int
    holes: int
    located: int
    wrong: int
    refusals: dict[str, int]
    lateral_mm: Span | None
    depth_mm: Span | None
    tilt_deg: Span | None
    roll_deg: Span | None
    in_95_region: float | None
    in_95_region_wilson95: Span | None
    time_s_p50: float | None
    plain_located: int
    plain_lateral_mm: Span | None
    paper_located: int
    paper_lateral_mm: Span | None


class PicturesReport(BaseModel):
    """What `crosspih bench vision --pictures --json` prints."""

    model_config = ConfigDict(frozen=True)

    pictures: str
    rows: list[RowFigures]
    all: RowFigures
    each: list[PictureVerdict]


def least_off(found: Pose, true: Pose, symmetry_order: int) -> Array:
    """(6,): the truth in the found hole's frame, m and rad, by the turn about its axis that leaves least roll.

    Turns that bring the outline onto itself do not count: `symmetry_order` of them, any of a round (0).
    """

    def off(turn_rad: float) -> Array:
        error = found.inverse() @ true @ Pose.from_rotvec([0.0, 0.0, turn_rad], [0.0, 0.0, 0.0])
        return np.concatenate([error.translation_m, error.rotvec_rad()])

    plain = off(0.0)
    if symmetry_order == 0:
        for _ in range(3):
            plain = off(-float(plain[5])) if abs(plain[5]) > 1e-12 else plain
        return plain
    turns = np.arange(symmetry_order) * (2.0 * np.pi / symmetry_order)
    return min((off(float(turn)) for turn in turns), key=lambda error: abs(float(error[5])))


def judged(answer: dict[str, Any], name: str, row: str, true: Pose | None, symmetry_order: int) -> PictureVerdict:
    """The verdict on one answer of the vision process; `true` is the hole in the base, None where there is none."""
    refusal = answer["refusal"]
    told: dict[str, Any] = {"name": name, "row": row, "is_the_hole": true is not None, "time_s": answer["time_s"]}
    if not answer["located"]:
        return PictureVerdict(**told, located=False, refusal=refusal["code"], text=refusal["text"])
    if true is None:
        return PictureVerdict(**told, located=True, quality=answer["quality"])
    found = Pose.from_matrix(answer["pose_base_hole"])
    error = least_off(found, true, symmetry_order)
    nees = float(error @ np.linalg.solve(np.asarray(answer["covariance"], dtype=float), error))
    return PictureVerdict(**told, located=True, nees=nees, quality=answer["quality"], **figures_of(error))


def figures_of(error: Array) -> dict[str, float]:
    """Lateral and depth in mm, tilt and roll in degrees, of an error (6,)."""
    return {
        "lateral_mm": float(np.hypot(error[0], error[1])) * 1e3,
        "depth_mm": float(error[2]) * 1e3,
        "tilt_deg": float(np.degrees(np.hypot(error[3], error[4]))),
        "roll_deg": float(np.degrees(error[5])),
    }


def figures(row: str, verdicts: list[PictureVerdict]) -> RowFigures:
    """Counts and quantiles of a row."""
    right = [one for one in verdicts if one.located and one.is_the_hole]

    def span(of: list[PictureVerdict], value: Callable[[PictureVerdict], float | None]) -> Span | None:
        values = np.abs([number for one in of if (number := value(one)) is not None])
        return (float(np.median(values)), float(np.percentile(values, 95))) if len(values) else None

    inside = sum(one.nees is not None and one.nees < IN_95 for one in right)
    times = [one.time_s for one in verdicts if one.time_s is not None]
    holes = [one for one in verdicts if one.is_the_hole]
    return RowFigures(
        row=row,
        pairs=len(verdicts),
        holes=len(holes),
        located=sum(one.located for one in verdicts),
        wrong=sum(one.wrong for one in verdicts),
        refusals=dict(Counter(one.refusal for one in verdicts if one.refusal is not None)),
        lateral_mm=span(right, lambda one: one.lateral_mm),
        depth_mm=span(right, lambda one: one.depth_mm),
        tilt_deg=span(right, lambda one: one.tilt_deg),
        roll_deg=span(right, lambda one: one.roll_deg),
        in_95_region=inside / len(right) if right else None,
        in_95_region_wilson95=wilson95(inside, len(right)) if right else None,
        time_s_p50=float(np.median(times)) if times else None,
        plain_located=sum(one.plain_located for one in verdicts),
        plain_lateral_mm=span(holes, lambda one: one.plain_lateral_mm),
        paper_located=sum(one.paper_located for one in verdicts),
        paper_lateral_mm=span(holes, lambda one: one.paper_lateral_mm),
    )
