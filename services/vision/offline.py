"""Vision without a bus: `python -m services.vision.offline` reads one job a line and answers one line, both JSON.

A job: {"left": [paths], "right": [paths], "calibration": {the camera message}, "cell": path or null, "annotated":
folder or null, "method": "rim" or "paper", "rectified": bool}. Several pictures per camera show the same hole under
different lights, paired in order. `rectified`: the calibration has no distortion because the pictures are rectified,
not because the distortion is unknown.

An answer: {"located": bool, "pose_base_hole": 4 x 4 or null, "covariance": 6 x 6 (x, y, z, rx, ry, rz of the hole's own
frame, m and rad) or null, "refusal": null or {"code", "text"}, "time_s": number, "quality": {name: number},
"warnings": [text]}; or, of a job that cannot be done, {"error": {"field", "text"}}.
"""

from __future__ import annotations

import json
import os
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TextIO

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from crosspih_common.config import CellFile, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, LocateMethod
from crosspih_common.messages.images import Pixels
from crosspih_common.modules import DEFAULT_CELL
from services.vision.config import VisionConfig
from services.vision.doubts import doubts_of
from services.vision.expected import expected_picture
from services.vision.fit.rim import Rimmed
from services.vision.fit.solve import Doubts
from services.vision.light import Light, linear_light, shown
from services.vision.locate import Located, locate_rim
from services.vision.paper import locate_paper
from services.vision.refusals import Doubtful, VisionRefusal
from services.vision.stereo import StereoModel
from services.vision.straightness import lenses_of

METHODS = {LocateMethod.RIM: locate_rim, LocateMethod.PAPER: locate_paper}
SIDES = ("left", "right")
# two lights show one hole: their poses differ by at most this squared distance (chi2, 6 dof, 99.99 %)
CONTRADICTION = 27.86
# refusals that are certain under one light, even if another light shows no fault: there is no such hole
NO_HOLE = frozenset({"flat_print", "shallow_pocket"})


class BadJob(Exception):
    """A job that cannot be done: the field at fault, and how to correct it."""

    def __init__(self, field: str, text: str) -> None:
        super().__init__(f"{field}: {text}")
        self.field, self.text = field, text


class Job(BaseModel):
    """One line of standard input."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    left: tuple[str, ...] = Field(min_length=1)
    right: tuple[str, ...] = Field(min_length=1)
    calibration: CameraCalibration
    cell: str | None = None
    annotated: str | None = None
    method: LocateMethod = LocateMethod.RIM
    rectified: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The knowledge before a picture is seen."""

    stereo: StereoModel
    hole: Rimmed
    nominal: Pose
    half_ranges: Array
    doubts: Doubts

    @classmethod
    def of(cls, calibration: CameraCalibration, cell: CellFile, rectified: bool = False) -> Scene:
        """The cameras by their calibration, the hole by the cell's file."""
        workcell, config = cell.workcell, cell.section("vision", VisionConfig)
        doubts = doubts_of(workcell.hole.tolerance, config.calibration_doubt)
        return cls(
            StereoModel.of(calibration, config.camera_correction.pose()),
            workcell.hole.shape(workcell.peg.shape()),
            workcell.hole_prior.pose_base_hole(),
            np.asarray(workcell.hole_prior.half_ranges(), float),
            replace(doubts, k1_untold_sd=doubts.k1_sd) if rectified else doubts,
        )


def read_picture(path: str, field: str) -> tuple[Pixels, str]:
    """The numbers of a picture as stored, uint8 or uint16, and `mono` or `bgr`. An orientation flag for viewers is
    ignored, because the calibration refers to the sensor's picture. Raises BadJob."""
    try:
        stored = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise BadJob(field, f"{path} cannot be read ({error.strerror}); give a picture's file") from None
    pixels = cv2.imdecode(stored, cv2.IMREAD_UNCHANGED) if stored.size else None
    if pixels is None:
        raise BadJob(field, f"{path} is not a picture that can be read; give PNG, TIFF, JPEG, BMP or PGM")
    if pixels.dtype not in (np.uint8, np.uint16):
        raise BadJob(field, f"{path} has {pixels.dtype} numbers; store it with 8 or 16 bits")
    if pixels.ndim == 2:
        return np.asarray(pixels, dtype=pixels.dtype), "mono"
    return np.ascontiguousarray(pixels[:, :, :3]), "bgr"


def lights_of(job: Job, stereo: StereoModel) -> list[tuple[Light, Light]]:
    """The pairs in linear light. Raises BadJob for a file that is no picture, or not of the calibration's size."""
    if len(job.left) != len(job.right):
        raise BadJob(
            "right", f"{len(job.left)} pictures left and {len(job.right)} right; give one of each camera for each light"
        )
    sides: list[list[Light]] = []
    for side, paths, camera in zip(SIDES, (job.left, job.right), stereo.cameras, strict=True):
        seen = []
        for path in paths:
            pixels, encoding = read_picture(path, side)
            height, width = pixels.shape[:2]
            if (width, height) != (camera.width_px, camera.height_px):
                turned = ", its sides exchanged" if (height, width) == (camera.width_px, camera.height_px) else ""
                raise BadJob(
                    side,
                    f"{path} is {width} x {height}, calibration.{side} says {camera.width_px} x {camera.height_px}"
                    f"{turned}; give the picture as the calibrated camera took it, neither scaled nor cropped",
                )
            seen.append(linear_light(pixels, encoding, camera.gamma))
        sides.append(seen)
    return list(zip(*sides, strict=True))


def best_of(found: list[Located]) -> Located:
    """The most certain of the results under several lights. Raises Doubtful where two of them contradict each other."""
    surest = min(found, key=lambda one: float(np.linalg.slogdet(one.covariance)[1]))
    for other in found:
        delta = surest.pose_base_hole.inverse() @ other.pose_base_hole
        off = np.concatenate([delta.translation_m, delta.rotvec_rad()])
        apart = float(off @ np.linalg.solve(surest.covariance + other.covariance, off))
        if apart > CONTRADICTION:
            raise Doubtful(
                f"two lights put the hole {np.linalg.norm(off[:3]) * 1e3:.2f} mm and "
                f"{np.degrees(np.linalg.norm(off[3:])):.2f} degrees apart, {apart:.0f} by their covariances, want less "
                f"than {CONTRADICTION:g}: was something moved between the pictures?"
            )
    return surest


def locate(job: Job, scene: Scene, pairs: list[tuple[Light, Light]]) -> tuple[Located | None, list[VisionRefusal]]:
    """The most certain pose among the pairs, and the refusals of the others; None where all refuse or two
    contradict."""
    found: list[Located] = []
    refusals: list[VisionRefusal] = []
    for left, right in pairs:
        try:
            one = METHODS[job.method](
                left, right, scene.stereo, scene.hole, scene.nominal, scene.half_ranges, scene.doubts
            )
            found.append(one)
        except VisionRefusal as refusal:
            refusals.append(refusal)
    certain = [refusal for refusal in refusals if refusal.code in NO_HOLE and refusal.certain]
    if not found or certain:
        return None, certain + [refusal for refusal in refusals if refusal not in certain]
    try:
        return best_of(found), refusals
    except Doubtful as refusal:
        return None, [refusal, *refusals]


def answer(job: Job, cell: CellFile) -> dict[str, Any]:
    """The answer for stdout. Raises BadJob."""
    scene = Scene.of(job.calibration, cell, job.rectified)
    pairs = lights_of(job, scene.stereo)
    started = time.perf_counter()
    found, refusals = locate(job, scene, pairs)
    time_s = time.perf_counter() - started
    if job.annotated is not None:
        if found is not None:
            pictures = [found.annotated_left, found.annotated_right]
        else:
            pictures = [
                expected_picture(
                    shown(light, scene.stereo.cameras[side].gamma), side, scene.stereo, scene.hole, scene.nominal,
                    refusals[0].code,
                )
                for side, light in enumerate(pairs[0])
            ]  # fmt: skip
        _write(Path(job.annotated), pictures)
    told = None
    if found is None:
        more = "" if len(refusals) == 1 else f" (other lights: {', '.join(one.code for one in refusals[1:])})"
        told = {"code": refusals[0].code, "text": f"{refusals[0]}{more}"}
    quality = {} if found is None else {name: float(value) for name, value in found.diagnostics.items()}
    warnings = () if found is None else found.warnings
    if found is None or job.method is LocateMethod.PAPER:
        # a lens that is not as calibrated may be the reason for the refusal
        lenses = lenses_of(pairs[0], scene.stereo.cameras)
        quality, warnings = quality | lenses.figures(), lenses.warnings()
    return {
        "located": found is not None,
        "pose_base_hole": None if found is None else found.pose_base_hole.matrix().tolist(),
        "covariance": None if found is None else np.asarray(found.covariance).tolist(),
        "refusal": told,
        "time_s": time_s,
        "quality": {
            **quality, "lights": float(len(pairs)), "lights_refused": float(len(refusals)),
        },
        "warnings": list(warnings),
    }  # fmt: skip


def _write(folder: Path, pictures: list[Any]) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for side, picture in zip(SIDES, pictures, strict=True):
            _, stored = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
            (folder / f"{side}.png").write_bytes(stored.tobytes())
    except OSError as error:
        raise BadJob("annotated", f"{folder} cannot be written ({error.strerror}); name a folder of your own") from None


class Cells:
    """The cells' files; each is read once, and again after a change."""

    def __init__(self) -> None:
        self._read: dict[tuple[str, int], CellFile] = {}

    def cell(self, path: str | None) -> CellFile:
        """Raises BadJob."""
        named = path or os.environ.get("CROSSPIH_CELL") or DEFAULT_CELL
        try:
            key = named, Path(named).stat().st_mtime_ns
            if key not in self._read:
                self._read[key] = load_cell(named)
            return self._read[key]
        except (ConfigError, OSError) as error:
            raise BadJob("cell", str(error)) from None


def _told(line: str, cells: Cells) -> dict[str, Any]:
    try:
        job = Job.model_validate_json(line)
        return answer(job, cells.cell(job.cell))
    except ValidationError as error:
        problem = error.errors()[0]
        field = ".".join(str(part) for part in problem["loc"]) or "job"
        return {"error": {"field": field, "text": problem["msg"]}}
    except BadJob as error:
        return {"error": {"field": error.field, "text": error.text}}


def serve(jobs: TextIO, answers: TextIO) -> None:
    """Answer until there are no more jobs; a line that is no job is answered with an error."""
    cells = Cells()
    for line in jobs:
        if line.strip():
            answers.write(json.dumps(_told(line, cells)) + "\n")
            answers.flush()


if __name__ == "__main__":
    serve(sys.stdin, sys.stdout)
