"""Tests whether readings at rest fit a sensor that is rotated on its mount, or one that reports the reaction force.

For a sensor rotated against its assumed frame, the forces are F_i = Q R_i^T L + F0 with one rotation Q for all
poses. Q, L and F0 are separated by poses in which gravity lies in well-spread directions; a reversed sign is an L that
points up.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import skew

_MIN_SD_N = 0.01
_STEPS = 40
_WORST_CONDITION = 300.0


@dataclass(frozen=True, slots=True, eq=False)
class MountingFit:
    """The rotation of the sensor in its assumed frame, and the remaining error.

    turn_rad (3,): rotation vector, turn_sd_rad its one standard deviation; reversed_sign: whether the weight points
    down only if all readings are negated; weight_base_n (3,): the weight, N, negated in that case; force_rms_n: per
    component.
    """

    turn_rad: Array
    turn_sd_rad: float
    reversed_sign: bool
    weight_base_n: Array
    force_rms_n: float

    @property
    def angle_rad(self) -> float:
        """The angle of the rotation, rad."""
        return float(np.linalg.norm(self.turn_rad))

    def in_words(self) -> str:
        """The rotation, for people: "turned by 30.0 degrees about its z axis"."""
        axis = self.turn_rad / max(self.angle_rad, 1e-12)
        index = int(np.argmax(np.abs(axis)))
        if abs(axis[index]) > np.cos(np.deg2rad(5.0)):
            angle = degrees(self.angle_rad) * float(np.sign(axis[index]))
            return f"turned by {angle:.1f} degrees about its {'xyz'[index]} axis"
        about = ", ".join(f"{value:.2f}" for value in axis)
        return f"turned by {degrees(self.angle_rad):.1f} degrees about the axis ({about}) of its own frame"


def hanging_weight_n(rotations: Array, forces: Array, down_base: Array) -> float:
    """The weight, N, from the change of forces (n, 3) with gravity's direction in the frame of rotations (n, 3, 3).

    Valid for any rotation or sign of the sensor; 0 if gravity's direction does not change.
    """
    directions = down_base @ rotations
    moved = np.sum((directions - directions.mean(axis=0)) ** 2)
    if moved < 1e-9:
        return 0.0
    return float(np.sqrt(np.sum((forces - forces.mean(axis=0)) ** 2) / moved))


def fit_mounting(rotations: Array, forces: Array, down_base: Array) -> MountingFit | None:
    """The rotation that fits forces (n, 3), sensor frame, at rotations_base_sensor (n, 3, 3); None if the poses do not
    determine it. `down_base` (3,) is the unit vector of gravity in the base.
    """
    if len(forces) < 4:
        return None
    fits = [fit for start in _starts(rotations, forces, down_base) if (fit := _fit(rotations, forces, start))]
    if not fits:
        return None
    turn, weight, rms, sd = min(fits, key=lambda fit: fit[2])
    upwards = bool(weight @ down_base < 0.0)
    turned = Rotation.from_matrix(turn.T).as_rotvec()
    return MountingFit(np.asarray(turned, dtype=float), sd, upwards, -weight if upwards else weight, rms)


def _starts(rotations: Array, forces: Array, down_base: Array) -> list[Array]:
    """Rotations near the one that maps gravity's directions to the forces, for either sign."""
    design = np.column_stack([down_base @ rotations, np.ones(len(forces))])
    linear = np.linalg.lstsq(design, forces, rcond=None)[0][:3].T
    left, _, right = np.linalg.svd(linear)
    handed = float(np.sign(np.linalg.det(left @ right)))
    same = left @ np.diag([1.0, 1.0, handed]) @ right
    reverse = -left @ np.diag([1.0, 1.0, -handed]) @ right
    return [np.eye(3), same, reverse]


def _fit(rotations: Array, forces: Array, start: Array) -> tuple[Array, Array, float, float] | None:
    """Gauss-Newton from a rotation: the rotation (3, 3), weight (3,), rms and the rotation's standard deviation,
    rad."""
    count, turn = len(forces), start
    to_sensor = np.swapaxes(rotations, 1, 2)
    weight, bias = _linear(turn @ to_sensor, forces)
    for _ in range(_STEPS):
        expected = to_sensor @ weight @ turn.T
        design = np.concatenate(
            [
                np.array([-skew(force) for force in expected]),
                turn @ to_sensor,
                np.broadcast_to(np.eye(3), (count, 3, 3)),
            ],
            axis=2,
        ).reshape(3 * count, 9)
        step = np.linalg.lstsq(design, (forces - expected - bias).ravel(), rcond=1e-9)[0][:3]
        length = float(np.linalg.norm(step))
        turn = Rotation.from_rotvec(step * min(1.0, 0.7 / max(length, 1e-12))).as_matrix() @ turn
        weight, bias = _linear(turn @ to_sensor, forces)
        if length < 1e-9:
            break
    residuals = forces - to_sensor @ weight @ turn.T - bias
    scale = np.array([max(float(np.linalg.norm(weight)), 1e-9)] * 3 + [1.0] * 6)
    if np.linalg.cond(design / scale) > _WORST_CONDITION:
        return None
    variance = float(np.sum(residuals**2)) / max(3 * count - 9, 1) + _MIN_SD_N**2
    covariance = variance * np.linalg.inv(design.T @ design)[:3, :3]
    sd = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    return turn, weight, float(np.sqrt(np.mean(residuals**2))), sd


def _linear(gravity: Array, forces: Array) -> tuple[Array, Array]:
    """Weight (3,) and bias (3,) for forces (n, 3) = gravity (n, 3, 3) @ weight + bias."""
    count = len(forces)
    design = np.concatenate([gravity, np.broadcast_to(np.eye(3), (count, 3, 3))], axis=2).reshape(3 * count, 6)
    solution = np.linalg.lstsq(design, forces.ravel(), rcond=None)[0]
    return solution[:3], solution[3:]
