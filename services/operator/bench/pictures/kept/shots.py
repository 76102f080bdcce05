"""Pairs of pictures with their truth, whatever folder they come from: a store of rendered scenes, or PNG pairs.

A store holds `set.json` and `scenes/`; a folder of pairs holds NAME_left.png, NAME_right.png and `truth.json`: by name
`is_the_hole`, `pose_base_hole` (4 x 4, or null), `distortion_k1`, `gamma`, and, where they are not the default cell's,
`calibration` (the camera message) and `peg` (the section cell.peg of a cell's file).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.config import Workcell
from crosspih_common.errors import CrosspihError
from crosspih_common.geometry import Pose
from services.operator.bench.pictures.camera.cameras import cell_pair
from services.operator.bench.pictures.camera.sensor import expose
from services.operator.bench.pictures.kept import store
from services.operator.bench.pictures.kept.sets import ROWS, PictureRow, SceneName, pairs_of, scene_of
from services.operator.bench.pictures.scenes import targets

Picture = NDArray[np.uint8] | NDArray[np.uint16]
TRUTH, SET, SCENES = "truth.json", "set.json", "scenes"
SEED_AND_PLAIN = re.compile(r"_\d+(_plain)?(?=_|$)")


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One pair, its calibration, and the truth; `peg` as in a cell's file, None: the cell's own."""

    name: str
    row: str
    left: Picture
    right: Picture
    calibration: dict[str, Any]
    is_the_hole: bool
    pose_base_hole: Pose | None
    peg: dict[str, Any] | None = None
    about: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class WantedShot:
    """One pair to come: its row and how to load it."""

    row: str
    name: str
    folder: Path
    scene: SceneName | None = None

    def load(self) -> Shot:
        """Raises CrosspihError where it is missing or is no pair."""
        return _rendered(self) if self.scene is not None else _stored(self)


def wanted_from(folder: Path, rows: list[str] | None, most: int | None) -> list[WantedShot]:
    """The pairs of a folder, by rows; at most so many a row. Raises CrosspihError: no such folder, or row."""
    if (folder / SET).is_file():
        every = list(_of_store(folder))
    elif (folder / TRUTH).is_file():
        names = json.loads((folder / TRUTH).read_text(encoding="utf-8"))
        every = [WantedShot(SEED_AND_PLAIN.sub("", name), name, folder) for name in names]
    else:
        raise CrosspihError(f"{folder}: has neither {SET} nor {TRUTH}; make pictures with `crosspih bench pictures`")
    there = list(dict.fromkeys(one.row for one in every))
    if unknown := [row for row in rows or [] if row not in there]:
        raise CrosspihError(f"--rows: {folder} has no row {unknown[0]!r}; it has {', '.join(there)}")
    kept: list[WantedShot] = []
    for row in there:
        if rows is None or row in rows:
            kept += [one for one in every if one.row == row][:most]
    return kept


def _of_store(folder: Path) -> Iterator[WantedShot]:
    about = json.loads((folder / SET).read_text(encoding="utf-8"))
    for name in about["rows"]:
        for index in range(pairs_of(name, about["share"])):
            scene = scene_of(ROWS[name], index, about["seed"])
            if (folder / SCENES / scene.file).is_file():
                yield WantedShot(name, f"{name}_{about['seed'] + index}", folder, scene)


def _rendered(wanted: WantedShot) -> Shot:
    assert wanted.scene is not None
    row = ROWS[wanted.row]
    rendered = store.load(wanted.folder / SCENES / wanted.scene.file)
    return shot_of(wanted.name, wanted.row, row, wanted.scene, rendered)


def shot_of(name: str, row_name: str, row: PictureRow, scene: SceneName, rendered: store.Rendered) -> Shot:
    """A scene as a row's cameras see it; noise and blur by the pair's name."""
    spec, pair, _ = scene.drawn()
    pair = row.lens(pair)
    rng = np.random.default_rng([scene.seed, *row_name.encode()])
    left, right = (
        expose(levels, lens, row.sensor, rng)
        for levels, lens in zip((rendered.left, rendered.right), pair.lenses, strict=True)
    )
    if row.swapped:
        left, right = right, left
    truth = rendered.truth
    is_the_hole = bool(truth["is_the_hole"]) and not row.swapped
    peg = None if spec.outline == Workcell().peg.outline else targets.peg_of(spec.outline)
    return Shot(
        name,
        row_name,
        left,
        right,
        pair.said(row.gamma_told or "linear", row.told),
        is_the_hole,
        Pose.from_matrix(truth["pose_base_hole"]) if is_the_hole else None,
        peg,
        truth,
    )


def _stored(wanted: WantedShot) -> Shot:
    truth = json.loads((wanted.folder / TRUTH).read_text(encoding="utf-8"))[wanted.name]
    pictures: list[Any] = []
    for side in ("left", "right"):
        path = wanted.folder / f"{wanted.name}_{side}.png"
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if picture is None:
            raise CrosspihError(f"{path}: there is no such picture, and {TRUTH} names it")
        pictures.append(np.asarray(picture, dtype=picture.dtype.type))
    calibration = truth.get("calibration")
    if calibration is None:
        k1 = float(truth.get("distortion_k1", 0.0))
        calibration = cell_pair().said(str(truth.get("gamma", "linear")).lower())
        for side in ("left", "right"):
            if k1:
                calibration[side] |= {"distortion_model": "plumb_bob", "distortion": [k1, 0.0, 0.0, 0.0]}
    return Shot(
        wanted.name,
        wanted.row,
        pictures[0],
        pictures[1],
        calibration,
        bool(truth["is_the_hole"]),
        None if truth["pose_base_hole"] is None else Pose.from_matrix(truth["pose_base_hole"]),
        truth.get("peg"),
        truth,
    )


def write_pair(shot: Shot, folder: Path, truths: dict[str, Any]) -> None:
    """The pair as PNG, and its entry in `truths`."""
    for side, picture in (("left", shot.left), ("right", shot.right)):
        (folder / f"{shot.name}_{side}.png").write_bytes(cv2.imencode(".png", picture)[1].tobytes())
    truths[shot.name] = shot.about | {
        "is_the_hole": shot.is_the_hole,
        "pose_base_hole": None if shot.pose_base_hole is None else shot.pose_base_hole.matrix().tolist(),
        "distortion_k1": (shot.calibration["left"]["distortion"] or [0.0])[0],
        "gamma": shot.calibration["left"]["gamma"],
        "calibration": shot.calibration,
        "row": shot.row,
        **({} if shot.peg is None else {"peg": shot.peg}),
    }
