"""`python -m services.vision.calibration`: reads one job a line and answers one line, both JSON; no bus, no arm.

Every job has `do` and `board` (the pattern's one line, `crosspih_common.config.board`):

- `see`: `pair` {"left", "right": files, null for none; "encodings": two of docs/wire.md, null for files; "gamma"}.
  Answers the corners found in each picture and in both, and what is still missing in all pairs seen so far. Each file
  is read once and kept for later jobs. With `draw` {"left", "right": files to write; "wanted": two outlines in pixels,
  or null} both pictures are drawn for people, as JPEG.
- `stereo`: `pairs`, `model` (the size of the distortion model; null: chosen by the held-out error).
- `hand_eye`: `pairs`, `flanges` (4 x 4 each, `pose_base_flange`), `calibration` (the camera message), `doubt`
  (the uncertainty that `stereo` reported, or null).
- `board`: `out`, a file that ends in .pdf or .png: the board in true size.

A job that cannot be done is answered by {"error": {"field", "text"}}, data that determine no result by
{"refused": text}.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Literal, TextIO

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from crosspih_common.calibration.fitting import CalibrationRefused
from crosspih_common.config.board import BoardPattern
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration, CameraModel, Gamma
from services.vision.calibration.boards import NONE, Board, Corners
from services.vision.calibration.coverage import missing_parts, missing_poses, parts_seen
from services.vision.calibration.drawing import drawn, write_drawn
from services.vision.calibration.hand_eye import CameraDoubt, calibrate_hand_eye, missing_turns
from services.vision.calibration.pairs import Pair, board_pose
from services.vision.calibration.printing import write_board
from services.vision.calibration.reports import hand_eye_report, stereo_report
from services.vision.calibration.stereo import MODELS, Rig, calibrate_stereo
from services.vision.light import linear_light
from services.vision.offline import BadJob, read_picture
from services.vision.stereo import Camera

ROUGH_FOCAL = 0.7  # focal length of an uncalibrated lens over the picture's width: good enough for advice
Matrix = tuple[tuple[float, float, float, float], ...]


class PairJob(BaseModel):
    """One pair of files."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    left: str | None
    right: str | None
    encodings: tuple[str | None, str | None] = (None, None)
    gamma: Gamma = Gamma.LINEAR


class DrawJob(BaseModel):
    """Where to write the pictures for people, and the outline that the board should have next in each."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    left: str
    right: str
    wanted: tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]] | None = None


class DoubtJob(BaseModel):
    """The uncertainty of the cameras by `stereo`: the size of the distortion model, its values in order, the
    covariance."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    model: str
    values: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]

    def read(self, cameras: tuple[Camera, Camera]) -> CameraDoubt:
        """Raises BadJob where the numbers do not fit the model."""
        if self.model not in MODELS:
            raise BadJob("doubt.model", f"{self.model!r}; want one of {', '.join(MODELS)}")
        left, right = ((camera.width_px, camera.height_px) for camera in cameras)
        rig = Rig((left, right), MODELS[self.model])
        count = len(rig.names())
        covariance = np.array(self.covariance, dtype=float)
        if len(self.values) != count or covariance.shape != (count, count):
            raise BadJob("doubt", f"{len(self.values)} values, the model {self.model} has {count}")
        return CameraDoubt(rig, np.array(self.values), covariance)


class CalibrationJob(BaseModel):
    """One line of standard input; the module's docstring says which fields each job uses."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    do: Literal["see", "stereo", "hand_eye", "board"]
    board: str
    pair: PairJob | None = None
    pairs: tuple[PairJob, ...] = ()
    flanges: tuple[Matrix, ...] = ()
    calibration: CameraCalibration | None = None
    doubt: DoubtJob | None = None
    model: str | None = None
    draw: DrawJob | None = None
    out: str | None = None
    folds: int = Field(default=4, ge=2, le=20)


class Calibrator:
    """Answers jobs; keeps the corners found so far, by file."""

    def __init__(self) -> None:
        self._boards: dict[str, Board] = {}
        self._seen: dict[tuple[str, str], tuple[Corners, tuple[int, int]]] = {}

    def answer(self, job: CalibrationJob) -> dict[str, Any]:
        """Raises BadJob, CalibrationRefused."""
        try:
            board = self._boards.setdefault(job.board, Board(BoardPattern.of(job.board)))
        except (ValueError, ConfigError) as error:
            raise BadJob("board", str(error)) from None
        if job.do == "board":
            return self._drawn(board, job)
        if job.do == "see":
            if job.pair is None:
                raise BadJob("pair", "name the pair of files")
            return self._told_of(board, job.pair, job.pairs, job.draw)
        seen = [self._pair(board, job.board, pair) for pair in job.pairs]
        if not seen:
            raise BadJob("pairs", "there are none; give pairs of pictures that show the board")
        pairs = [pair for pair, _ in seen]
        if job.do == "stereo":
            if job.model is not None and job.model not in MODELS:
                raise BadJob("model", f"{job.model!r}; want one of {', '.join(MODELS)}")
            sizes = self._sizes([size for _, size in seen])
            fit = calibrate_stereo(pairs, board.pattern, sizes, job.model, job.folds)
            parts = parts_seen(pairs, sizes)
            missing = missing_parts(parts) + missing_poses(fit.board_poses(), board.pattern)
            return stereo_report(fit, board.pattern, parts, missing, job.pairs[0].gamma)
        if job.calibration is None or len(job.flanges) != len(pairs):
            raise BadJob("flanges", f"{len(job.flanges)} poses of the arm for {len(pairs)} pairs, or no calibration")
        told = job.calibration
        cameras = Camera.of(told.left), Camera.of(told.right)
        for side, (name, camera) in enumerate(zip(("left", "right"), cameras, strict=True)):
            sizes_seen = {size[side] for _, size in seen if size[side] != (0, 0)}
            if sizes_seen - {(camera.width_px, camera.height_px)}:
                raise BadJob(
                    name, f"pictures of {sizes_seen}, the calibration's are {camera.width_px} x {camera.height_px}"
                )
        flanges = [Pose.from_matrix(matrix) for matrix in job.flanges]
        doubt = None if job.doubt is None else job.doubt.read(cameras)
        beside = told.pose_left_right.pose()
        found = calibrate_hand_eye(pairs, flanges, board.pattern, cameras, beside, job.folds, doubt)
        shown = [flange for pair, flange in zip(pairs, flanges, strict=True) if len(pair[0]) + len(pair[1])]
        return hand_eye_report(found, told, missing_turns(shown))

    def _drawn(self, board: Board, job: CalibrationJob) -> dict[str, Any]:
        if job.out is None:
            raise BadJob("out", "name a file that ends in .pdf or .png")
        try:
            write_board(board, Path(job.out))
        except (ValueError, OSError) as error:
            raise BadJob("out", str(error)) from None
        return {"written": job.out, "size_m": board.pattern.size_m.tolist()}

    def _told_of(
        self, board: Board, pair: PairJob, before: tuple[PairJob, ...], draw: DrawJob | None
    ) -> dict[str, Any]:
        every = [self._pair(board, str(board.pattern), one) for one in (*before, pair)]
        (left, right), _ = every[-1]
        parts = parts_seen([seen for seen, _ in every], self._sizes([size for _, size in every]))
        if draw is not None:
            self._draw(pair, [seen for seen, _ in every], parts, draw)
        poses = [pose for seen, size in every if (pose := _roughly(seen[0], board.pattern, size[0])) is not None]
        return {
            "left": len(left),
            "right": len(right),
            "both": len(np.intersect1d(left.ids, right.ids)),
            "all": board.pattern.count,
            "parts": parts,
            "missing": missing_parts(parts) + missing_poses(poses, board.pattern),
        }

    @staticmethod
    def _draw(pair: PairJob, seen: list[Pair], parts: list[list[list[int]]], draw: DrawJob) -> None:
        for side, (path, encoding, out) in enumerate(
            zip((pair.left, pair.right), pair.encodings, (draw.left, draw.right), strict=True)
        ):
            if path is None:
                continue
            field = ("left", "right")[side]
            wanted = None if draw.wanted is None else np.array(draw.wanted[side])
            grey = _grey(path, encoding, pair.gamma, field)
            shown = drawn(grey, seen[-1][side], [one[side] for one in seen[:-1]], parts[side], wanted)
            try:
                write_drawn(shown, Path(out))
            except OSError as error:
                raise BadJob(f"draw.{field}", f"{out} cannot be written ({error.strerror})") from None

    def _pair(self, board: Board, name: str, pair: PairJob) -> tuple[Pair, tuple[tuple[int, int], tuple[int, int]]]:
        left, right = (
            self._picture(board, name, path, encoding, pair.gamma, field)
            for path, encoding, field in zip((pair.left, pair.right), pair.encodings, ("left", "right"), strict=True)
        )
        return (left[0], right[0]), (left[1], right[1])

    def _picture(
        self, board: Board, name: str, path: str | None, encoding: str | None, gamma: Gamma, field: str
    ) -> tuple[Corners, tuple[int, int]]:
        if path is None:
            return NONE, (0, 0)
        key = str(BoardPattern.of(name)), path
        if key not in self._seen:
            grey = _grey(path, encoding, gamma, field)
            self._seen[key] = board.find(grey), (grey.shape[1], grey.shape[0])
        return self._seen[key]

    @staticmethod
    def _sizes(
        sizes: list[tuple[tuple[int, int], tuple[int, int]]],
    ) -> tuple[tuple[int, int], tuple[int, int]]:
        found = []
        for side, name in enumerate(("left", "right")):
            each = {size[side] for size in sizes if size[side] != (0, 0)}
            if len(each) != 1:
                raise BadJob(name, f"pictures of {len(each)} sizes ({each}); give those of one camera, as it took them")
            found.append(each.pop())
        return found[0], found[1]


def _grey(path: str, encoding: str | None, gamma: Gamma, field: str) -> NDArray[np.uint8]:
    """Raises BadJob."""
    pixels, stored_as = read_picture(path, field)
    light = linear_light(pixels, encoding or stored_as, gamma)
    return np.asarray(np.rint(np.clip(light, 0.0, 255.0)), dtype=np.uint8)


def _roughly(corners: Corners, pattern: BoardPattern, size: tuple[int, int]) -> Pose | None:
    if not len(corners):
        return None
    focal, (width, height) = ROUGH_FOCAL * size[0], size
    rough = CameraModel(width_px=width, height_px=height, fx_px=focal, fy_px=focal, cx_px=width / 2, cy_px=height / 2)
    return board_pose(corners, pattern, Camera.of(rough))


def _told(line: str, calibrator: Calibrator) -> dict[str, Any]:
    try:
        return calibrator.answer(CalibrationJob.model_validate_json(line))
    except ValidationError as error:
        problem = error.errors()[0]
        return {"error": {"field": ".".join(str(part) for part in problem["loc"]) or "job", "text": problem["msg"]}}
    except BadJob as error:
        return {"error": {"field": error.field, "text": error.text}}
    except CalibrationRefused as error:
        return {"refused": str(error)}


def serve(jobs: TextIO, answers: TextIO) -> None:
    """Answer until there are no more jobs."""
    calibrator = Calibrator()
    for line in jobs:
        if line.strip():
            answers.write(json.dumps(_told(line, calibrator)) + "\n")
            answers.flush()


if __name__ == "__main__":
    serve(sys.stdin, sys.stdout)
