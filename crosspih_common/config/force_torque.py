"""How the cell's force/torque sensor is mounted and read, and what it can bear: `cell.force_torque`."""

from __future__ import annotations

from enum import Enum
from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator

from crosspih_common.config.correction import MountingCorrection
from crosspih_common.config.placement import Placement
from crosspih_common.config.section import Section
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.wrench.mounting import SensorMounting

_POUND_N = 4.4482216152605
_INCH_M = 0.0254
FORCE_UNITS = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "lbf": _POUND_N, "kgf": 9.80665}
MOMENT_UNITS = {
    "Nm": 1.0,
    "mNm": 1e-3,
    "Nmm": 1e-3,
    "lbf_in": _POUND_N * _INCH_M,
    "lbf_ft": _POUND_N * _INCH_M * 12.0,
    "kgf_cm": 0.0980665,
}
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


class Reports(str, Enum):
    """The sign convention of the sensor: it reports the load on the peg, or the reaction to it."""

    LOAD = "load"  # a push against the tip reads -Fz: the load on the peg
    REACTION = "reaction"  # the same push reads +Fz: what the peg does to the world


class SensorSection(Section):
    """The sensor's mounting, the meaning of its numbers, and its range."""

    pose_flange_sensor: Placement | None = Field(
        default=None, description="the sensor's frame on the flange; left out, it is the peg's frame"
    )
    correction: MountingCorrection = Field(
        default=MountingCorrection(),
        description="of the sensor's frame, in the peg frame; written by `crosspih calibrate refine`",
    )
    reports: Reports = Field(default=Reports.LOAD, description="load: a push against the tip reads -Fz")
    axes: tuple[Axis, Axis, Axis] = Field(
        default=("x", "y", "z"),
        description="x, y and z of the sensor's frame, each as one of the three numbers that the driver gives",
    )
    force_unit: Literal["N", "mN", "kN", "lbf", "kgf"] = "N"
    moment_unit: Literal["Nm", "mNm", "Nmm", "lbf_in", "lbf_ft", "kgf_cm"] = "Nm"
    range_n: float = Field(default=300.0, gt=0.0, description="of each force, by the sensor's data sheet")
    range_nm: float = Field(default=30.0, gt=0.0, description="of each moment, by the sensor's data sheet")
    tilt_limit_rad: float = Field(
        default=0.2, gt=0.0, le=1.0, description="between cell.gravity_base_m_s2 and the gravity that the sensor finds"
    )
    weighed_n: float | None = Field(
        default=None, gt=0.0, description="what hangs on the sensor, by scales: a calibration is held to it within 10 %"
    )

    @field_validator("axes")
    @classmethod
    def _right_handed(cls, axes: tuple[Axis, Axis, Axis]) -> tuple[Axis, Axis, Axis]:
        if sorted(name[-1] for name in axes) != ["x", "y", "z"]:
            raise ValueError("wants each of x, y and z once, with or without a minus: [-y, x, z]")
        if np.linalg.det(_matrix(axes)) < 0.0:
            raise ValueError("are left-handed; reverse one of them, and use `reports: reaction` for a reversed sign")
        return axes

    def mounting(self, pose_flange_peg: Pose) -> SensorMounting:
        """How raw readings become wrenches on the peg; the peg's frame on the flange is given."""
        nominal = Pose.identity()
        if self.pose_flange_sensor is not None:
            nominal = pose_flange_peg.inverse() @ self.pose_flange_sensor.pose()
        return SensorMounting(
            pose_peg_sensor=self.correction.pose() @ nominal,
            sign=1 if self.reports is Reports.LOAD else -1,
            axes=_matrix(self.axes),
            n_per_unit=FORCE_UNITS[self.force_unit],
            nm_per_unit=MOMENT_UNITS[self.moment_unit],
        )

    def as_drawn(self) -> SensorSection:
        """The same section without the correction: the mounting as in the drawing."""
        return self.model_copy(update={"correction": MountingCorrection()})

    def turned(self, pose_flange_peg: Pose, turn_rad: Array) -> Placement:
        """`pose_flange_sensor` of a sensor that is rotated by a rotation vector (3,), rad, in its own frame."""
        current = pose_flange_peg if self.pose_flange_sensor is None else self.pose_flange_sensor.pose()
        mounting = self.mounting(pose_flange_peg).pose_peg_sensor
        real = mounting @ Pose.from_rotvec(turn_rad, np.zeros(3))
        turn = (pose_flange_peg @ self.correction.pose().inverse() @ real).rotvec_rad()
        return Placement(
            position_m=tuple(float(value) for value in current.translation_m),
            rotvec_rad=tuple(float(value) for value in turn),
        )


def _matrix(axes: tuple[Axis, Axis, Axis]) -> Array:
    """The rotation (3, 3) that takes the reported numbers to the sensor's frame."""
    matrix = np.zeros((3, 3))
    for row, name in enumerate(axes):
        matrix[row, "xyz".index(name[-1])] = -1.0 if name.startswith("-") else 1.0
    return matrix


def with_correction_moved(content: dict[str, Any]) -> dict[str, Any]:
    """A cell file's content with the sensor's correction moved to its present key, `cell.force_torque.correction`.

    The old key `force_torque.sensor_correction` was not visible to the arm. Raises ValueError if both are set.
    """
    section = content.get("force_torque")
    if not isinstance(section, dict) or "sensor_correction" not in section:
        return content
    rest = {name: value for name, value in section.items() if name != "sensor_correction"}
    cell = content.get("cell") or {}
    if not isinstance(cell, dict):
        return content
    sensor = cell.get("force_torque") or {}
    if not isinstance(sensor, dict):
        return content
    if "correction" in sensor:
        raise ValueError(
            "force_torque.sensor_correction: is now cell.force_torque.correction, which is there too; remove the former"
        )
    moved = {**sensor, "correction": section["sensor_correction"]}
    return {**content, "cell": {**cell, "force_torque": moved}, "force_torque": rest}
