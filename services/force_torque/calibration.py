"""Six-pose calibration of a force/torque sensor that carries a tool: bias, weight and centroid (Eqs. 14-16).

At rest and in free air the sensor reads, in its own frame, F = R^T L + F0 and M = r x F + k, with R the rotation
`rotation_base_sensor`, L the tool's weight vector in the base frame (pointing down), r the tool's centroid in the
sensor frame, F0 the force bias and k = M0 - r x F0 (Eq. 14). Both are linear: p = (r, k) follows from the moments
(Eq. 15), (L, F0) from the forces (Eq. 16), and M0 = k + r x F0. L may be left free, which also finds how far the base
stands out of level.

Errors: `CalibrationError` (ValueError)
    `PosesDoNotSpan`      the poses leave a parameter undetermined; says which pose to add
    `ResidualsTooLarge`   the readings do not fit a rigid tool at rest; names the worst pose
    `CalibrationFileError`  (calibration_file.py) a file is missing, malformed or of another kind
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import skew

DOWN_BASE = np.array([0.0, 0.0, -1.0])


class CalibrationError(ValueError):
    """The sensor could not be calibrated from these readings."""


class PosesDoNotSpan(CalibrationError):
    """The poses leave a parameter undetermined."""


class ResidualsTooLarge(CalibrationError):
    """The readings do not fit a rigid tool at rest."""


@dataclass(frozen=True, slots=True, eq=False)
class StaticReading:
    """One pose at rest in free air: `rotation_base_sensor` (3, 3) and the mean reading (6,), N and Nm, sensor frame."""

    rotation_base_sensor: Array
    wrench: Array

    def __post_init__(self) -> None:
        rotation = np.asarray(self.rotation_base_sensor, dtype=float)
        wrench = np.asarray(self.wrench, dtype=float)
        if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=2e-3):
            raise CalibrationError("rotation_base_sensor wants a (3, 3) rotation matrix")
        if wrench.shape != (6,) or not np.all(np.isfinite(wrench)):
            raise CalibrationError(f"wrench wants six finite numbers, got {wrench!r}")
        object.__setattr__(self, "rotation_base_sensor", rotation)
        object.__setattr__(self, "wrench", wrench)


@dataclass(frozen=True, slots=True, eq=False)
class ToolParameters:
    """What the sensor reads without contact: bias (6,), weight vector in the base (3,), N, centroid (3,), m."""

    bias: Array
    weight_base_n: Array
    centroid_sensor_m: Array

    @property
    def weight_n(self) -> float:
        """The tool's weight."""
        return float(np.linalg.norm(self.weight_base_n))

    @property
    def base_tilt_rad(self) -> float:
        """The angle between the weight vector found and the base frame's -z."""
        down = float(self.weight_base_n @ DOWN_BASE)
        return float(np.arctan2(np.linalg.norm(np.cross(self.weight_base_n, DOWN_BASE)), down))

    def free_air_wrench(self, rotation_base_sensor: ArrayLike) -> Array:
        """The reading (..., 6) expected without contact at orientations (..., 3, 3), sensor frame."""
        rotation = np.asarray(rotation_base_sensor, dtype=float)
        force = np.einsum("...ji,j->...i", rotation, self.weight_base_n)
        moment = np.cross(self.centroid_sensor_m, force)
        return np.asarray(self.bias + np.concatenate([force, moment], axis=-1), dtype=float)


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The parameters with what they rest on.

    `residuals` (n, 6) reading minus model a pose; `force_rms_n`, `moment_rms_nm` root mean square a component;
    `condition_force`, `condition_moment` of the two scaled designs; `bias_sd` (6,), `weight_sd_n` one standard
    deviation of each found from the residuals' own scatter, slightly cautious for the moments (0 when there are no
    degrees of freedom left).
    """

    tool: ToolParameters
    residuals: Array
    force_rms_n: float
    moment_rms_nm: float
    condition_force: float
    condition_moment: float
    bias_sd: Array
    weight_sd_n: float

    @property
    def parameters_eq15(self) -> Array:
        """The paper's p (6,) = (r, k): centroid, m, and k = M0 - r x F0, Nm."""
        centroid = self.tool.centroid_sensor_m
        return np.concatenate([centroid, self.tool.bias[3:] - np.cross(centroid, self.tool.bias[:3])])


def calibrate(
    readings: Sequence[StaticReading],
    *,
    gravity_free: bool = True,
    minimum_poses: int = 6,
    condition_limit: float = 30.0,
    force_rms_limit_n: float = 0.5,
    moment_rms_limit_nm: float = 0.05,
) -> Calibration:
    """Bias, weight vector and centroid from readings in free air, by least squares.

    With `gravity_free` the direction of gravity in the base is found too (three numbers instead of one); otherwise the
    base is taken as level. Raises `PosesDoNotSpan` for fewer than `minimum_poses` or a design whose condition number
    is above `condition_limit`, naming the gravity direction to add; `ResidualsTooLarge` naming the worst pose.
    """
    if len(readings) < minimum_poses:
        raise PosesDoNotSpan(f"{len(readings)} poses, want at least {minimum_poses}: {_advice(readings)}")
    rotations = np.array([reading.rotation_base_sensor for reading in readings])
    wrenches = np.array([reading.wrench for reading in readings])
    forces, moments = wrenches[:, :3], wrenches[:, 3:]
    count = len(readings)

    gravity = rotations.transpose(0, 2, 1) if gravity_free else (rotations.transpose(0, 2, 1) @ DOWN_BASE)[:, :, None]
    force_design = np.concatenate([gravity, np.tile(np.eye(3), (count, 1, 1))], axis=2).reshape(3 * count, -1)
    condition_force = float(np.linalg.cond(force_design))
    if condition_force > condition_limit:
        raise PosesDoNotSpan(
            f"weight and force bias cannot be told apart (condition number {condition_force:.3g}, "
            f"limit {condition_limit:g}): {_advice(readings)}"
        )
    solution_force = np.linalg.lstsq(force_design, forces.ravel(), rcond=None)[0]
    weight_base = solution_force[:3] if gravity_free else solution_force[0] * DOWN_BASE
    force_bias = solution_force[-3:]
    if not gravity_free and solution_force[0] < 0.0:
        raise ResidualsTooLarge("the weight found points up: the readings' sign is that of the sensor on the tool")

    # M = r x F + k is -skew(F) r + k. Forces in units of the weight keep the condition number free of units.
    scale = max(float(np.linalg.norm(weight_base)), 1e-9)
    cross_force = np.array([-skew(force / scale) for force in forces])
    moment_design = np.concatenate([cross_force, np.tile(np.eye(3), (count, 1, 1))], axis=2).reshape(3 * count, 6)
    condition_moment = float(np.linalg.cond(moment_design))
    if condition_moment > condition_limit:
        raise PosesDoNotSpan(
            f"centroid and moment bias cannot be told apart (condition number {condition_moment:.3g}, "
            f"limit {condition_limit:g}): {_advice(readings)}"
        )
    solution_moment = np.linalg.lstsq(moment_design, moments.ravel(), rcond=None)[0]
    centroid = solution_moment[:3] / scale
    moment_bias = solution_moment[3:] + np.cross(centroid, force_bias)

    tool = ToolParameters(np.concatenate([force_bias, moment_bias]), weight_base, centroid)
    residuals = np.column_stack(
        [
            forces - (force_design @ solution_force).reshape(count, 3),
            moments - (moment_design @ solution_moment).reshape(count, 3),
        ]
    )
    force_rms = float(np.sqrt(np.mean(residuals[:, :3] ** 2)))
    moment_rms = float(np.sqrt(np.mean(residuals[:, 3:] ** 2)))
    _check_residuals(residuals, force_rms, moment_rms, force_rms_limit_n, moment_rms_limit_nm)

    force_covariance = _covariance(force_design, residuals[:, :3])
    moment_covariance = _covariance(moment_design, residuals[:, 3:])
    # M0 = k + r x F0 in (r scale, k): the derivative to the scaled centroid is -skew(F0) / scale.
    lever = np.hstack([-skew(force_bias) / scale, np.eye(3)])
    through_force = skew(centroid) @ force_covariance[-3:, -3:] @ skew(centroid).T
    bias_variance = np.concatenate(
        [np.diag(force_covariance)[-3:], np.diag(lever @ moment_covariance @ lever.T + through_force)]
    )
    along = weight_base / scale if gravity_free else np.ones(1)
    weight_block = force_covariance[:-3, :-3]
    return Calibration(
        tool=tool,
        residuals=residuals,
        force_rms_n=force_rms,
        moment_rms_nm=moment_rms,
        condition_force=condition_force,
        condition_moment=condition_moment,
        bias_sd=np.sqrt(np.maximum(bias_variance, 0.0)),
        weight_sd_n=float(np.sqrt(max(0.0, along @ weight_block @ along))),
    )


def _covariance(design: Array, residuals: Array) -> Array:
    freedom = design.shape[0] - design.shape[1]
    variance = float(np.sum(residuals**2)) / freedom if freedom > 0 else 0.0
    return np.asarray(variance * np.linalg.inv(design.T @ design), dtype=float)


def _check_residuals(
    residuals: Array, force_rms: float, moment_rms: float, force_limit: float, moment_limit: float
) -> None:
    if force_rms <= force_limit and moment_rms <= moment_limit:
        return
    by_force = np.linalg.norm(residuals[:, :3], axis=1) / force_limit
    by_moment = np.linalg.norm(residuals[:, 3:], axis=1) / moment_limit
    worst = int(np.argmax(np.maximum(by_force, by_moment)))
    raise ResidualsTooLarge(
        f"residual rms {force_rms:.3f} N and {moment_rms:.4f} Nm, limits {force_limit:g} N and {moment_limit:g} Nm; "
        f"worst is pose {worst + 1} with {np.linalg.norm(residuals[worst, :3]):.3f} N and "
        f"{np.linalg.norm(residuals[worst, 3:]):.4f} Nm: repeat it at rest and clear of everything"
    )


def missing_gravity_direction(readings: Sequence[StaticReading]) -> Array:
    """The sensor axis (3,), one of +-x, +-y, +-z, that lies farthest from gravity in all poses so far."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    if not readings:
        return np.array([0.0, 0.0, -1.0])
    directions = np.array([reading.rotation_base_sensor.T @ DOWN_BASE for reading in readings])
    return np.asarray(axes[int(np.argmin(np.max(axes @ directions.T, axis=1)))], dtype=float)


def _advice(readings: Sequence[StaticReading]) -> str:
    axis = missing_gravity_direction(readings)
    index = int(np.argmax(np.abs(axis)))
    name = ("+" if axis[index] > 0.0 else "-") + "xyz"[index]
    return f"add a pose in which the sensor's {name} axis points down, turned about the vertical from the others"
