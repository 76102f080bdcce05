"""Draw docs/vision-gallery.jpg: of each row of the pictures' table a left picture with the rim that was found.

    .venv/bin/python -m docs.make_vision_gallery tests/pictures/set

Where vision refused, the tile says the refusal's code.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration
from services.operator.bench.pictures.kept.shots import Shot, wanted_from
from services.vision.light import linear_light, shown
from services.vision.locate import locate_rim
from services.vision.refusals import VisionRefusal
from services.vision.stereo import StereoModel

TILE_PX, NAME_PX, COLUMNS = 200, 36, 8
REACH_M = 0.045  # of what a tile shows about the hole's middle
GREEN, ORANGE, WHITE = (70, 220, 70), (40, 150, 255), (255, 255, 255)
"""BGR."""


def tile(shot: Shot, found: Pose | None, said: str, stereo: StereoModel) -> NDArray[np.uint8]:
    """The left picture about where the hole is, or should be, with both lines of the rim at the pose that was found."""
    workcell = Workcell() if shot.peg is None else Workcell.model_validate({"peg": shot.peg})
    into = stereo.pose_base_camera.inverse()
    about = into @ (found or shot.pose_base_hole or workcell.hole_prior.pose_base_hole())
    middle = stereo.project(about.translation_m)[0]
    reach = float(np.linalg.norm(stereo.project(about.apply([REACH_M, 0.0, 0.0]))[0] - middle))
    scale = TILE_PX / (2.0 * reach)
    across = np.array([[scale, 0.0, TILE_PX / 2 - scale * middle[0]], [0.0, scale, TILE_PX / 2 - scale * middle[1]]])
    left = stereo.left
    grey = shown(linear_light(shot.left, "", left.gamma), left.gamma)
    smooth = cv2.INTER_CUBIC if scale > 1.0 else cv2.INTER_AREA
    picture = cv2.cvtColor(cv2.warpAffine(grey, across, (TILE_PX, TILE_PX), flags=smooth), cv2.COLOR_GRAY2BGR)
    if found is not None:
        hole = workcell.hole.shape(workcell.peg.shape())
        for line in (hole.outer_rim_m(), hole.inner_rim_m()):
            ends = np.roll(line, -1, axis=0)
            shares = np.linspace(0.0, 1.0, 9)[:-1, None, None]
            points = stereo.project((into @ found).apply(np.concatenate(list((1 - shares) * line + shares * ends))))[0]
            order = np.arange(len(points)).reshape(8, -1).T.ravel()
            at = points[order] @ across[:, :2].T + across[:, 2]
            cv2.polylines(picture, [np.rint(at * 16).astype(np.int32)], True, GREEN, 1, cv2.LINE_AA, 4)
    name = np.zeros((NAME_PX, TILE_PX, 3), np.uint8)
    for row, (text, colour) in enumerate(((shot.row, WHITE), (said, GREEN if found is not None else ORANGE))):
        cv2.putText(name, text, (5, 14 + 15 * row), cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, 1, cv2.LINE_AA)
    return np.asarray(np.vstack([name, picture]), dtype=np.uint8)


def main(folder: Path, out: Path) -> None:
    """A tile a row."""
    tiles = []
    for row in dict.fromkeys(one.row for one in wanted_from(folder, None, None)):
        shot = wanted_from(folder, [row], 1)[0].load()
        workcell = Workcell() if shot.peg is None else Workcell.model_validate({"peg": shot.peg})
        stereo = StereoModel.of(CameraCalibration.model_validate({"stamp_ns": 0, **shot.calibration}))
        prior, hole = workcell.hole_prior, workcell.hole.shape(workcell.peg.shape())
        found, said = None, "found"
        try:
            located = locate_rim(shot.left, shot.right, stereo, hole, prior.pose_base_hole(), prior.half_ranges())
            found = located.pose_base_hole
        except VisionRefusal as refusal:
            said = refusal.code
        tiles.append(tile(shot, found, said, stereo))
    while len(tiles) % COLUMNS:
        tiles.append(np.zeros_like(tiles[0]))
    lines = [np.hstack(tiles[start : start + COLUMNS]) for start in range(0, len(tiles), COLUMNS)]
    cv2.imwrite(str(out), np.vstack(lines), [cv2.IMWRITE_JPEG_QUALITY, 82])


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "tests/pictures/set"), Path("docs/vision-gallery.jpg"))
