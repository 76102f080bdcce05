"""Converts a calibration file of any known kind to the camera message.

- the camera message (docs/wire.md, CameraCalibration) as YAML or JSON; also its older form;
- ROS camera_info: one file per camera, left first, or one file with both;
- OpenCV's stereo calibration: one file, or intrinsics and extrinsics.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration, Gamma, PoseData
from services.operator.locate import camera_info, opencv_file
from services.operator.locate.reading import CameraFileError, documents

KINDS = (
    "the camera message (left, right, pose_left_right), ROS camera_info of both cameras, or OpenCV's stereo "
    "calibration (M1, D1, M2, D2, R, T); see docs/locate.md"
)


@dataclass(frozen=True, slots=True)
class FileReading:
    """How to read a file where it does not say itself.

    `pose_base_camera`: the pose of the left camera. `gamma`: overrides the file's. `unit_m`: the length of 1 in the
    file (ROS and OpenCV). `rectified`: the pictures are rectified ones, so that `P` describes them (ROS and OpenCV).
    `sizes`: (width, height) of the left picture and of the right one, called only where a file has none.
    """

    pose_base_camera: Pose
    gamma: Gamma | None = None
    unit_m: float = 1.0
    rectified: bool = False
    sizes: Callable[[], tuple[tuple[int, int], tuple[int, int]]] | None = None


def read_calibration(paths: list[Path], reading: FileReading) -> CameraCalibration:
    """The message from one file, or from two that belong together. Raises CalibrationFileError naming
    field and remedy.
    """
    found = [document for path in paths for document in documents(path)]
    where = " and ".join(str(path) for path in paths)
    told = _message(found, reading, where)
    given = next((document["pose_base_camera"] for document in found if "pose_base_camera" in document), None)
    told = {"pose_base_camera": PoseData.of(reading.pose_base_camera) if given is None else given, **told}
    if reading.gamma is not None:
        for side in ("left", "right"):
            if isinstance(told.get(side), dict):
                told[side] = {**told[side], "gamma": reading.gamma.value}
    try:
        calibration = CameraCalibration.model_validate(told)
    except ValidationError as error:
        problem = error.errors()[0]
        field = ".".join(str(part) for part in problem["loc"]) or where
        raise CameraFileError(
            f"calibration: {field} of {where}: {problem['msg'].removeprefix('Value error, ')}"
        ) from None
    return calibration


def _message(found: list[dict[str, Any]], reading: FileReading, where: str) -> dict[str, Any]:
    if len(found) == 1 and ("pose_left_right" in found[0] or "baseline_m" in found[0]):
        return dict(found[0])
    infos = [info for document in found for info in camera_info.infos_of(document)]
    if infos:
        if len(infos) != 2:
            raise CameraFileError(
                f"calibration: {where} holds camera_info of {len(infos)} camera{'s' * (len(infos) > 1)}; give that of "
                "both, left first: --calibration left.yaml --calibration right.yaml"
            )
        return camera_info.message_of(infos[0], infos[1], reading.unit_m, reading.rectified)
    merged = {name: value for document in found for name, value in document.items()}
    if opencv_file.is_one(merged):
        return opencv_file.message_of(merged, reading.unit_m, reading.rectified, reading.sizes)
    if "left" in merged and "right" in merged:
        raise CameraFileError(
            f"calibration: pose_left_right is missing in {where}; say where the right camera stands in the left one's "
            "frame, position_m and quaternion_xyzw"
        )
    raise CameraFileError(f"calibration: {where} is none of {KINDS}")
