"""The calibration's file: YAML, checked by pydantic, with date, residuals and the poses used."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from numpy.typing import ArrayLike
from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

from crosspih_common.plain_yaml import text_of_file, yaml_of
from crosspih_common.shapes import Peg
from crosspih_common.shapes.likeness import is_same_peg, peg_as_data
from crosspih_common.wrench import Payload, SensorMounting
from services.force_torque.calibration import Calibration, CalibrationError, StaticReading

Vector3 = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
Vector6 = Annotated[tuple[float, ...], Field(min_length=6, max_length=6)]
Vector36 = Annotated[tuple[float, ...], Field(min_length=36, max_length=36)]
Joints = Annotated[tuple[float, ...], Field(min_length=6, max_length=7)]
Vector9 = Annotated[tuple[float, ...], Field(min_length=9, max_length=9)]


class CalibrationFileError(CalibrationError):
    """A calibration file is missing, malformed or of another kind."""


class CalibrationPose(BaseModel):
    """One pose used: the orientation (rows of `rotation_base_sensor`), the mean reading and its residual."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    rotation_base_sensor: Vector9
    wrench: Vector6
    residual: Vector6
    joints_rad: Joints | None = None


class CalibratedPeg(BaseModel):
    """The peg that hung on the sensor, in the form of `crosspih_common.shapes.likeness.peg_as_data`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    outline: str
    corners_m: tuple[tuple[float, float], ...] = Field(min_length=3)
    body_start_m: float
    taper_start_m: float
    apex_m: float
    tip_m: float


class CalibrationFile(BaseModel):
    """A six-pose calibration on disk. Wrenches are (Fx, Fy, Fz, Mx, My, Mz), N and Nm, in the sensor frame."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    kind: Literal["crosspih/ft-calibration"] = "crosspih/ft-calibration"
    version: Literal[1] = 1
    calibrated_at: AwareDatetime
    cell: str
    bias: Vector6
    bias_sd: Vector6
    weight_base_n: Vector3
    weight_n: float = Field(gt=0.0)
    weight_sd_n: float = Field(ge=0.0)
    base_tilt_rad: float
    centroid_sensor_m: Vector3
    force_rms_n: float = Field(ge=0.0)
    moment_rms_nm: float = Field(ge=0.0)
    condition_force: float
    condition_moment: float
    poses: tuple[CalibrationPose, ...]
    temperature_c: float | None = Field(default=None, description="of the sensor or the room then, where it was told")
    peg_of_raw: Vector36 | None = Field(
        default=None, description="(6, 6) by rows: from raw readings to the peg, as mounted then; none: the identity"
    )

    peg: CalibratedPeg | None = Field(default=None, description="what hung on it; none in a file of before")
    warnings: tuple[str, ...] = Field(default=(), description="what was to be looked at when it was made")

    def payload(self, mounting: SensorMounting | None = None, peg: Peg | None = None) -> Payload:
        """The input of the compensation. Raises `CalibrationFileError` if the mounting or the peg differs from that of
        the calibration."""
        if peg is not None and self.peg is not None and not is_same_peg(self.peg.model_dump(), peg):
            raise CalibrationFileError(
                f"it was made with another peg ({self.peg.outline!r}, by its contour not the {peg.outline.name!r} of "
                "this cell), which weighs something else; calibrate the sensor again (`crosspih calibrate ft`)"
            )
        mounting = SensorMounting() if mounting is None else mounting
        made_with = np.eye(6) if self.peg_of_raw is None else np.reshape(self.peg_of_raw, (6, 6))
        if not np.allclose(made_with, mounting.peg_of_raw, rtol=1e-9, atol=1e-9):
            raise CalibrationFileError(
                "the sensor's mounting in the cell's file (cell.force_torque) has changed since this calibration; "
                "calibrate the sensor again (`crosspih calibrate ft`)"
            )
        return Payload(np.array(self.bias), np.array(self.weight_base_n), np.array(self.centroid_sensor_m), mounting)


def calibration_file(
    calibration: Calibration,
    readings: list[StaticReading],
    *,
    calibrated_at: str,
    cell: str,
    joints_rad: list[list[float]] | None = None,
    mounting: SensorMounting | None = None,
    down_base: ArrayLike = (0.0, 0.0, -1.0),
    temperature_c: float | None = None,
    peg: Peg | None = None,
) -> CalibrationFile:
    """The file's content; `calibrated_at` is ISO 8601 with a time zone, passed in because the core reads no clock.

    `mounting` converted the readings from raw numbers, `down_base` (3,) is the reference of the tilt, `readings` are
    those that the calibration used, and `peg` hung on the sensor.

    Raises `CalibrationFileError` naming the field that does not fit.
    """
    payload = calibration.payload
    joints: list[list[float]] | list[None] = [None] * len(readings) if joints_rad is None else joints_rad
    if len(joints) != len(readings):
        raise CalibrationFileError(f"joints_rad has {len(joints)} poses, readings have {len(readings)}")
    content = {
        "calibrated_at": calibrated_at,
        "cell": cell,
        "bias": payload.bias.tolist(),
        "bias_sd": calibration.bias_sd.tolist(),
        "weight_base_n": payload.weight_base_n.tolist(),
        "weight_n": payload.weight_n,
        "weight_sd_n": calibration.weight_sd_n,
        "base_tilt_rad": payload.tilt_rad(down_base),
        "centroid_sensor_m": payload.centroid_sensor_m.tolist(),
        "force_rms_n": calibration.force_rms_n,
        "moment_rms_nm": calibration.moment_rms_nm,
        "condition_force": calibration.condition_force,
        "condition_moment": calibration.condition_moment,
        "temperature_c": temperature_c,
        "poses": [
            {
                "rotation_base_sensor": reading.rotation_base_sensor.ravel().tolist(),
                "wrench": reading.wrench.tolist(),
                "residual": residual.tolist(),
                "joints_rad": None if joint is None else [float(value) for value in joint],
            }
            for reading, residual, joint in zip(readings, calibration.residuals, joints, strict=True)
        ],
        "peg_of_raw": None if mounting is None else mounting.peg_of_raw.ravel().tolist(),
        "peg": None if peg is None else peg_as_data(peg),
        "warnings": list(calibration.warnings),
    }
    return _validated(content, "the calibration")


def save_calibration(content: CalibrationFile, path: Path) -> None:
    """Write the file whole or not at all; its folder is created if missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = yaml.safe_dump(content.model_dump(mode="json"), sort_keys=False, default_flow_style=None, width=120)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)


def load_calibration(path: Path) -> CalibrationFile:
    """Read and check a file. Raises `CalibrationFileError` naming the path and the field."""
    try:
        content = yaml_of(text_of_file(path))
    except OSError as error:
        raise CalibrationFileError(f"{path}: cannot be read ({error.strerror}); calibrate the sensor first") from error
    except yaml.YAMLError as error:
        raise CalibrationFileError(f"{path}: is not YAML ({error})") from error
    return _validated(content, str(path))


def _validated(content: object, where: str) -> CalibrationFile:
    try:
        return CalibrationFile.model_validate(content)
    except ValidationError as error:
        faults = "; ".join(f"{'.'.join(map(str, fault['loc'])) or 'file'}: {fault['msg']}" for fault in error.errors())
        raise CalibrationFileError(f"{where}: {faults}") from error
