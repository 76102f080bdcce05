"""Six-pose calibration of a force/torque sensor that carries a tool: bias, weight and centroid (Eqs. 14-16).

At rest and in free air the sensor reads, in its own frame, F = R^T L + F0 and M = r x F + k, with R the rotation
`rotation_base_sensor`, L the tool's weight vector in the base frame (pointing down), r the tool's centroid in the
sensor frame, F0 the force bias and k = M0 - r x F0 (Eq. 14). Both are linear: p = (r, k) follows from the moments
(Eq. 15), (L, F0) from the forces (Eq. 16), and M0 = k + r x F0. L may be left free, which also finds the tilt of the
base.

Errors: `CalibrationError` (ValueError)
        `PosesDoNotSpan`      the poses leave a parameter undetermined; says which pose to add
        `ChannelAtFault`      a channel is stuck, clipped, or drifts by more than the residuals' limit; names it
        `ResidualsTooLarge`   the readings do not fit a rigid tool at rest; names the worst pose
        `NothingHangs`        the readings do not follow gravity: no weight hangs on the sensor
        `WeightPointsUp`      every sign is reversed, or the base's orientation differs from the cell's file
        `MountingTurned`      the readings fit a sensor that is rotated on its mount; says by how much
        `WeightDiffers`       the weight found is not the one on the scales; names the unit that would explain it
        `CalibrationFileError`  (calibration_file.py) a file is missing, malformed or of another kind
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.config.force_torque import FORCE_UNITS
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import skew
from crosspih_common.wrench import Payload
from services.force_torque.channels import Channels, beyond_noise, clipped, drift, first_of_copies, stuck
from services.force_torque.mounting_fit import MountingFit, fit_mounting, hanging_weight_n

_SIGMAS = 4.0  # a rotation or a weight within so many standard deviations of zero counts as zero


class CalibrationError(ValueError):
    """The sensor could not be calibrated from these readings."""


class PosesDoNotSpan(CalibrationError):
    """The poses leave a parameter undetermined."""


class ResidualsTooLarge(CalibrationError):
    """The readings do not fit a rigid tool at rest."""


class ChannelAtFault(CalibrationError):
    """A channel of the sensor is stuck, clipped or drifts."""


class NothingHangs(CalibrationError):
    """The readings do not follow gravity."""


class WeightPointsUp(CalibrationError):
    """The weight found does not point along gravity as the cell's file states it."""


class WeightDiffers(CalibrationError):
    """The weight found is not the one on the scales."""


class MountingTurned(CalibrationError):
    """The readings fit a sensor that is turned on its mount; `fit` says how."""

    def __init__(self, text: str, fit: MountingFit) -> None:
        super().__init__(text)
        self.fit = fit


@dataclass(frozen=True, slots=True)
class CalibrationLimits:
    """The limits of a calibration.

    `down_base` (3,) is the direction of gravity in the base frame, of any length, and `tilt_rad` the largest deviation
    of the weight from it; range_n and range_nm are the sensor's range. Less than `least_weight_n` counts as no weight;
    a rotation of the sensor above `turn_rad` counts as rotated. `weighed_n`: the weight by scales, N, if known; the
    found one must agree within `weighed_share`.
    """

    minimum_poses: int = 6
    condition: float = 30.0
    force_rms_n: float = 0.5
    moment_rms_nm: float = 0.05
    down_base: tuple[float, ...] = (0.0, 0.0, -1.0)
    tilt_rad: float = 0.2
    least_weight_n: float = 0.2
    turn_rad: float = radians(5.0)
    range_n: float = 300.0
    range_nm: float = 30.0
    weighed_n: float | None = None
    weighed_share: float = 0.1

    def down(self) -> Array:
        """`down_base` at unit length."""
        down = np.asarray(self.down_base, dtype=float)
        return np.asarray(down / np.linalg.norm(down), dtype=float)


@dataclass(frozen=True, slots=True, eq=False)
class StaticReading:
    """One pose at rest in free air: `rotation_base_sensor` (3, 3), the mean reading (6,), N and Nm, sensor frame, and
    the standard deviation (6,) of that mean, where it is known."""

    rotation_base_sensor: Array
    wrench: Array
    sd: Array | None = None

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
class Calibration:
    """The parameters and the evidence for them.

    `residuals` (n, 6): reading minus model per pose; `force_rms_n`, `moment_rms_nm`: root mean square per component;
    `condition_force`, `condition_moment`: of the two scaled designs; `bias_sd` (6,), `weight_sd_n`: one standard
    deviation from the scatter of the residuals, slightly cautious for the moments (0 without degrees of freedom).
    `poses` (k,): the readings that are no copies of another; `warnings`: findings to check that are no reason for a
    refusal.
    """

    payload: Payload
    residuals: Array
    force_rms_n: float
    moment_rms_nm: float
    condition_force: float
    condition_moment: float
    bias_sd: Array
    weight_sd_n: float
    poses: tuple[int, ...]
    warnings: tuple[str, ...]

    @property
    def parameters_eq15(self) -> Array:
        """The paper's p (6,) = (r, k): centroid, m, and k = M0 - r x F0, Nm."""
        centroid = self.payload.centroid_sensor_m
        return np.concatenate([centroid, self.payload.bias[3:] - np.cross(centroid, self.payload.bias[:3])])


def calibrate(
    readings: Sequence[StaticReading], *, gravity_free: bool = True, limits: CalibrationLimits | None = None
) -> Calibration:
    """Bias, weight vector and centroid from readings in free air, by least squares.

    With `gravity_free` the direction of gravity in the base is found too (three numbers instead of one); otherwise it
    is that of `limits.down_base`. Raises `PosesDoNotSpan` for too few poses or a design whose condition number is above
    the limit, naming the gravity direction to add; `NothingHangs`, `WeightPointsUp`, `MountingTurned` and
    `WeightDiffers`, each with the setting to mend; `ChannelAtFault` naming the channel; `ResidualsTooLarge` naming the
    worst pose. Copies of a reading count once.
    """
    limits = CalibrationLimits() if limits is None else limits
    down = limits.down()
    given = len(readings)
    poses = first_of_copies(
        np.array([reading.rotation_base_sensor for reading in readings]), np.array([each.wrench for each in readings])
    )
    readings = [readings[index] for index in poses]
    if len(readings) < limits.minimum_poses:
        copies = f" that are no copies of another ({given} were given)" if len(readings) < given else ""
        raise PosesDoNotSpan(
            f"{len(readings)} poses{copies}, want at least {limits.minimum_poses}: {_advice(readings, down)}"
        )
    rotations = np.array([reading.rotation_base_sensor for reading in readings])
    wrenches = np.array([reading.wrench for reading in readings])
    forces, moments = wrenches[:, :3], wrenches[:, 3:]
    count = len(readings)

    gravity = rotations.transpose(0, 2, 1) if gravity_free else (down @ rotations)[:, :, None]
    force_design = np.concatenate([gravity, np.tile(np.eye(3), (count, 1, 1))], axis=2).reshape(3 * count, -1)
    condition_force = float(np.linalg.cond(force_design))
    if condition_force > limits.condition:
        raise PosesDoNotSpan(
            f"weight and force bias cannot be told apart (condition number {condition_force:.3g}, "
            f"limit {limits.condition:g}): {_advice(readings, down)}"
        )
    by_force = Channels(("Fx", "Fy", "Fz"), "N", limits.force_rms_n, limits.range_n)
    by_moment = Channels(("Mx", "My", "Mz"), "Nm", limits.moment_rms_nm, limits.range_nm)
    shaped_force = force_design.reshape(count, 3, -1)
    _check_channel(stuck(forces, by_force) or clipped(shaped_force, forces, by_force))
    solution_force = np.linalg.lstsq(force_design, forces.ravel(), rcond=None)[0]
    weight_base = solution_force[:3] if gravity_free else solution_force[0] * down
    force_bias = solution_force[-3:]
    force_residuals = forces - (force_design @ solution_force).reshape(count, 3)
    drifts = [drift(shaped_force, forces, by_force)]
    if drifts[0] is not None and drifts[0][1] > limits.force_rms_n:
        raise ChannelAtFault(drifts[0][0])
    _check_mounting(rotations, forces, force_residuals, weight_base, limits)

    # M = r x (F - F0) + M0 is -skew(F - F0) r + M0. In units of the weight, and without the force bias (k of Eq. 15
    # would include it), the condition number depends on the poses alone.
    scale = max(float(np.linalg.norm(weight_base)), 1e-9)
    cross_force = np.array([-skew(force / scale) for force in forces - force_bias])
    moment_design = np.concatenate([cross_force, np.tile(np.eye(3), (count, 1, 1))], axis=2).reshape(3 * count, 6)
    condition_moment = float(np.linalg.cond(moment_design))
    if condition_moment > limits.condition:
        raise PosesDoNotSpan(
            f"centroid and moment bias cannot be told apart (condition number {condition_moment:.3g}, "
            f"limit {limits.condition:g}): {_advice(readings, down)}"
        )
    shaped_moment = moment_design.reshape(count, 3, 6)
    _check_channel(clipped(shaped_moment, moments, by_moment))
    drifts.append(drift(shaped_moment, moments, by_moment))
    if drifts[1] is not None and drifts[1][1] > limits.moment_rms_nm:
        raise ChannelAtFault(drifts[1][0])
    solution_moment = np.linalg.lstsq(moment_design, moments.ravel(), rcond=None)[0]
    centroid = solution_moment[:3] / scale
    moment_bias = solution_moment[3:]

    payload = Payload(np.concatenate([force_bias, moment_bias]), weight_base, centroid)
    moment_residuals = moments - (moment_design @ solution_moment).reshape(count, 3)
    residuals = np.column_stack([force_residuals, moment_residuals])
    force_rms = float(np.sqrt(np.mean(residuals[:, :3] ** 2)))
    moment_rms = float(np.sqrt(np.mean(residuals[:, 3:] ** 2)))
    _check_residuals(residuals, force_rms, moment_rms, limits.force_rms_n, limits.moment_rms_nm)
    _check_weight(weight_base, limits)

    force_covariance = _covariance(force_design, residuals[:, :3])
    moment_covariance = _covariance(moment_design, residuals[:, 3:])
    through_force = skew(centroid) @ force_covariance[-3:, -3:] @ skew(centroid).T
    bias_variance = np.concatenate([np.diag(force_covariance)[-3:], np.diag(moment_covariance[3:, 3:] + through_force)])
    along = weight_base / scale if gravity_free else np.ones(1)
    weight_block = force_covariance[:-3, :-3]
    return Calibration(
        payload=payload,
        residuals=residuals,
        force_rms_n=force_rms,
        moment_rms_nm=moment_rms,
        condition_force=condition_force,
        condition_moment=condition_moment,
        bias_sd=np.sqrt(np.maximum(bias_variance, 0.0)),
        weight_sd_n=float(np.sqrt(max(0.0, along @ weight_block @ along))),
        poses=tuple(poses),
        warnings=tuple(
            said
            for said in (
                *(found[0] for found in drifts if found is not None),
                beyond_noise(residuals[:, :3], _noise(readings, slice(0, 3)), by_force),
                beyond_noise(residuals[:, 3:], _noise(readings, slice(3, 6)), by_moment),
            )
            if said is not None
        ),
    )


def _noise(readings: Sequence[StaticReading], part: slice) -> Array | None:
    """The standard deviations (n, 3) of the readings; None if any reading has none."""
    sds = [reading.sd for reading in readings]
    return None if any(sd is None for sd in sds) else np.array(sds)[:, part]


def _check_channel(fault: str | None) -> None:
    if fault is not None:
        raise ChannelAtFault(fault)


def _covariance(design: Array, residuals: Array) -> Array:
    freedom = design.shape[0] - design.shape[1]
    variance = float(np.sum(residuals**2)) / freedom if freedom > 0 else 0.0
    return np.asarray(variance * np.linalg.inv(design.T @ design), dtype=float)


def _check_mounting(
    rotations: Array, forces: Array, residuals: Array, weight_base: Array, limits: CalibrationLimits
) -> None:
    """Refuse gross errors: nothing hangs, every sign is reversed, or the sensor is rotated on its mount."""
    down = limits.down()
    hanging, weight = hanging_weight_n(rotations, forces, down), float(np.linalg.norm(weight_base))
    rms = float(np.sqrt(np.mean(residuals**2)))
    weight_sd = rms / np.sqrt(len(forces))
    fits = rms <= limits.force_rms_n
    if hanging < limits.least_weight_n or (fits and weight < _SIGMAS * weight_sd):
        raise NothingHangs(
            f"no weight hangs on the sensor: as it is turned about, its forces follow gravity by {hanging:.3f} N only "
            f"(at least {limits.least_weight_n:g} N are wanted). Mount the peg; if it is mounted, see whether the "
            "sensor's numbers change at all when you push it, and cell.force_torque.force_unit"
        )
    fit = fit_mounting(rotations, forces, down)
    if fit is not None and _turned(fit, rms, limits):
        sign = " and that reports the reaction (cell.force_torque.reports: reaction)" if fit.reversed_sign else ""
        raise MountingTurned(
            f"the readings fit a sensor {fit.in_words()}{sign}, with a residual of {fit.force_rms_n:.3f} N instead of "
            f"{rms:.3f} N: set how it is mounted in cell.force_torque.pose_flange_sensor",
            fit,
        )
    if fits:
        _check_down(weight_base, limits)


def _turned(fit: MountingFit, rms: float, limits: CalibrationLimits) -> bool:
    return (
        fit.force_rms_n <= limits.force_rms_n
        and fit.angle_rad > max(limits.turn_rad, _SIGMAS * fit.turn_sd_rad)
        and fit.force_rms_n < 0.5 * rms
    )


def _check_down(weight_base: Array, limits: CalibrationLimits) -> None:
    """The weight must point along gravity as the cell's file states it."""
    down = limits.down()
    angle = float(np.arctan2(np.linalg.norm(np.cross(weight_base, down)), weight_base @ down))
    if angle <= limits.tilt_rad:
        return
    found = ", ".join(f"{round(value, 2) + 0.0:.2f}" for value in 9.81 * weight_base / np.linalg.norm(weight_base))
    if angle > 2.0 * np.pi / 3.0:
        raise WeightPointsUp(
            f"the weight found points up, {degrees(angle):.0f} degrees from cell.gravity_base_m_s2: the sensor reports "
            "the reaction, every sign reversed (set cell.force_torque.reports: reaction), or the base hangs the other "
            f"way round (set cell.gravity_base_m_s2: [{found}])"
        )
    raise WeightPointsUp(
        f"the weight found points {degrees(angle):.1f} degrees away from cell.gravity_base_m_s2, more than "
        f"{degrees(limits.tilt_rad):.1f}: if the base stands so, set cell.gravity_base_m_s2: [{found}]; if not, see "
        "how the sensor is mounted (cell.force_torque.pose_flange_sensor)"
    )


def _check_weight(weight_base: Array, limits: CalibrationLimits) -> None:
    weight = float(np.linalg.norm(weight_base))
    if limits.weighed_n is None or abs(weight - limits.weighed_n) <= limits.weighed_share * limits.weighed_n:
        return
    units = [
        name
        for name, factor in FORCE_UNITS.items()
        if abs(weight * factor / limits.weighed_n - 1.0) <= limits.weighed_share
    ]
    mend = f"it fits a sensor that reports {units[0]}: set cell.force_torque.force_unit" if units else "weigh it again"
    raise WeightDiffers(
        f"the weight found is {weight:.4g} N, by scales (cell.force_torque.weighed_n) {limits.weighed_n:.4g} N; {mend}"
    )


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


def missing_gravity_direction(readings: Sequence[StaticReading], down_base: ArrayLike = (0.0, 0.0, -1.0)) -> Array:
    """The sensor axis (3,), one of +-x, +-y, +-z, that lies farthest from gravity in all poses so far."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    if not readings:
        return np.array([0.0, 0.0, -1.0])
    directions = np.array([np.asarray(down_base, float) @ reading.rotation_base_sensor for reading in readings])
    return np.asarray(axes[int(np.argmin(np.max(axes @ directions.T, axis=1)))], dtype=float)


def _advice(readings: Sequence[StaticReading], down_base: Array) -> str:
    axis = missing_gravity_direction(readings, down_base)
    index = int(np.argmax(np.abs(axis)))
    name = ("+" if axis[index] > 0.0 else "-") + "xyz"[index]
    return f"add a pose in which the sensor's {name} axis points down, turned about the vertical from the others"
