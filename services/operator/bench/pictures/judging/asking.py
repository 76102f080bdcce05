"""Pairs of pictures put to the vision process, and the same ones to a plain recipe and to the paper's method."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from crosspih_common.config import Workcell
from services.operator.bench.pictures.judging.plain_pnp import plain_pose
from services.operator.bench.pictures.judging.verdicts import RENDERED_BY, PictureVerdict, figures_of, judged, least_off
from services.operator.bench.pictures.kept.shots import Shot, WantedShot
from services.operator.locate.worker import OfflineVision


def answers(wanted: Iterable[WantedShot], annotated: Path | None, beside: bool) -> Iterator[PictureVerdict]:
    """The verdict on each pair, in order. `annotated`: a folder for the annotated pictures, one folder a pair;
    `beside`: ask the plain recipe and the paper's method too. Raises BadInput, VisionLost, CrosspihError."""
    with tempfile.TemporaryDirectory() as folder, OfflineVision() as vision:
        for one in wanted:
            yield verdict_on(one.load(), vision, Path(folder), annotated, beside)


def verdict_on(shot: Shot, vision: OfflineVision, folder: Path, annotated: Path | None, beside: bool) -> PictureVerdict:
    """One pair, through files in a folder, as a user's would come."""
    workcell = Workcell() if shot.peg is None else Workcell.model_validate({"peg": shot.peg})
    hole = workcell.hole.shape(workcell.peg.shape())
    order = hole.outline.symmetry_order
    job: dict[str, Any] = {"calibration": shot.calibration, "cell": None, "method": "rim", "annotated": None}
    for side, picture in (("left", shot.left), ("right", shot.right)):
        path = folder / f"{side}.png"
        path.write_bytes(cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes())
        job[side] = [str(path)]
    if shot.peg is not None:
        cell = folder / f"{workcell.peg.outline}.yaml"
        cell.write_text(yaml.safe_dump({"cell": {"peg": shot.peg}}), encoding="utf-8")
        job["cell"] = str(cell)
    if annotated is not None:
        job["annotated"] = str(annotated / shot.name)
    verdict = judged(vision.ask(job), shot.name, shot.row, shot.pose_base_hole, order)
    verdict = verdict.model_copy(update={RENDERED_BY: str(shot.about.get(RENDERED_BY, ""))})
    if not beside:
        return verdict
    more: dict[str, Any] = {}
    plain = plain_pose((shot.left, shot.right), shot.calibration, hole, workcell.hole_prior.pose_base_hole())
    true = shot.pose_base_hole
    more["plain_located"] = plain is not None
    if plain is not None and true is not None:
        more["plain_lateral_mm"] = figures_of(least_off(plain, true, order))["lateral_mm"]
    paper = vision.ask(job | {"method": "paper", "annotated": None})
    more["paper_located"] = bool(paper["located"])
    if paper["located"] and true is not None:
        across = true.inverse().apply(np.asarray(paper["pose_base_hole"])[:3, 3])[:2]
        more["paper_lateral_mm"] = float(np.hypot(*across)) * 1e3
    return verdict.model_copy(update=more)
