"""The cameras' calibration from a file in the form of the camera message, for cameras that know nothing of it."""

from __future__ import annotations

from pathlib import Path

import yaml
from pydantic import ValidationError

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration, CameraModel, DistortionModel, PoseData
from crosspih_common.plain_yaml import text_of_file, yaml_of


def read_calibration(path: Path | None, field: str, workcell: Workcell) -> CameraCalibration:
    """The calibration of a file, YAML or JSON (docs/locate.md). `field` is the setting that names it.

    Without `pose_base_camera` the cameras stand where the cell has them. Raises ConfigError naming field and file.
    """
    if path is None:
        raise ConfigError(f"{field}: names no file; give the cameras' calibration (docs/locate.md)")
    try:
        said = yaml_of(text_of_file(path))
    except (OSError, yaml.YAMLError) as error:
        raise ConfigError(f"{field}: {path} cannot be read: {error}") from None
    if not isinstance(said, dict):
        raise ConfigError(f"{field}: {path} holds no fields, want left, right, pose_left_right, ...")
    # where the cameras stand is mostly the cell's to say
    standing = {"pose_base_camera": PoseData.of(workcell.camera.pose_base_camera())}
    try:
        return CameraCalibration.model_validate({**standing, **said})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"{field}: {path}: {where}: {first['msg']}") from None


def calibration_of_cell(workcell: Workcell) -> CameraCalibration:
    """What `cell.camera` says of them: for cameras that `crosspih calibrate stereo` has not seen yet."""
    camera = workcell.camera
    left, right = (
        CameraModel(
            width_px=camera.width_px, height_px=camera.height_px, fx_px=camera.fx_px, fy_px=camera.fy_px,
            cx_px=camera.cx_px, cy_px=camera.cy_px,
            distortion_model=DistortionModel.PLUMB_BOB if any(numbers) else DistortionModel.NONE,
            distortion=numbers if any(numbers) else (),
        )
        for numbers in camera.distortions()
    )  # fmt: skip
    return CameraCalibration(
        left=left,
        right=right,
        pose_left_right=PoseData.of(Pose.from_translation([camera.baseline_m, 0.0, 0.0])),
        pose_base_camera=PoseData.of(camera.pose_base_camera()),
    )
