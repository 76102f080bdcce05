"""The payload behind the sensor, subtracted from its readings so that thresholds, caps and estimates see contact only.

Without contact the sensor reads F = R^T L + F0 and M = r x R^T L + M0 in its own frame, with R its orientation in the
base, L the payload's weight vector in the base, r the payload's centroid, F0 and M0 the bias (the paper's Eqs. 14-16).
The arm's control layer and the force_torque service both use this module, so that both have the same number.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rows import Rows
from crosspih_common.geometry.wrench import skew
from crosspih_common.messages import SetPayload
from crosspih_common.wrench.mounting import SensorMounting


@dataclass(frozen=True, slots=True, eq=False)
class Payload:
    """Bias (6,), weight vector in the base frame (3,), N, centroid in the sensor frame (3,), m, and the mounting.

    The bias is in N and Nm in the sensor's frame, after the mounting has read the raw numbers.
    """

    bias: Array
    weight_base_n: Array
    centroid_sensor_m: Array
    mounting: SensorMounting = field(default_factory=SensorMounting)
    _sensor_of_force: Array = field(init=False, repr=False)
    _peg_of_force: Array = field(init=False, repr=False)
    _peg_of_bias: Array = field(init=False, repr=False)
    _plain: tuple[list[float], list[list[float]]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name, shape in (("bias", 6), ("weight_base_n", 3), ("centroid_sensor_m", 3)):
            value = np.array(getattr(self, name), dtype=float)
            if value.shape != (shape,) or not np.all(np.isfinite(value)):
                raise ValueError(f"Payload wants {name} as {shape} finite numbers, got {getattr(self, name)!r}")
            object.__setattr__(self, name, value)
        of_force = np.vstack([np.eye(3), skew(self.centroid_sensor_m)])
        to_peg = self.mounting.peg_of_sensor
        # force in the sensor frame (3,) = R_peg_sensor^T force in the peg frame
        object.__setattr__(self, "_sensor_of_force", of_force)
        object.__setattr__(self, "_peg_of_force", to_peg @ of_force @ self.mounting.pose_peg_sensor.rotation.T)
        object.__setattr__(self, "_peg_of_bias", to_peg @ self.bias)
        # each number of `load` with what one newton of weight along x, y and z of the peg frame adds to it
        table = np.column_stack([self._peg_of_bias, self._peg_of_force])
        object.__setattr__(self, "_plain", (self.weight_base_n.tolist(), table.tolist()))

    @classmethod
    def from_command(cls, command: SetPayload, mounting: SensorMounting | None = None) -> Payload:
        """From a SetPayload; its gravity need not be of unit length. Raises ValueError where it has none."""
        down = np.asarray(command.gravity_base, float)
        length = float(np.linalg.norm(down))
        if not length > 0.0:
            raise ValueError("gravity_base wants a direction, got three zeros")
        return cls(
            np.asarray(command.bias, float),
            down / length * command.weight_n,
            np.asarray(command.centroid_ft_m, float),
            SensorMounting() if mounting is None else mounting,
        )

    @classmethod
    def tare(cls, raw: ArrayLike, mounting: SensorMounting | None = None) -> Payload:
        """Take a whole raw reading (6,) as bias: valid as long as the orientation stays."""
        mounting = SensorMounting() if mounting is None else mounting
        return cls(mounting.sensor(raw), np.zeros(3), np.zeros(3), mounting)

    @property
    def weight_n(self) -> float:
        """The weight."""
        return float(np.linalg.norm(self.weight_base_n))

    def tilt_rad(self, down_base: ArrayLike) -> float:
        """The angle between the weight vector and a direction (3,) of the base frame, of any length; 0 for none."""
        down = np.asarray(down_base, dtype=float)
        return float(np.arctan2(np.linalg.norm(np.cross(self.weight_base_n, down)), self.weight_base_n @ down))

    def free_air(self, rotation_base_sensor: ArrayLike) -> Array:
        """The wrench (..., 6), sensor frame, N and Nm, read without contact at sensor orientations (..., 3, 3)."""
        force = self.weight_base_n @ np.asarray(rotation_base_sensor, dtype=float)
        return np.asarray(self.bias + force @ self._sensor_of_force.T, dtype=float)

    def load(self, rotation_base_peg: ArrayLike) -> Array:
        """The wrench without contact (..., 6), peg frame, N and Nm, at orientations of the peg frame (..., 3, 3)."""
        force = self.weight_base_n @ np.asarray(rotation_base_peg, dtype=float)
        return np.asarray(self._peg_of_bias + force @ self._peg_of_force.T, dtype=float)

    def load_of(self, rotation_base_peg: Rows) -> list[float]:
        """`load` (6,) at one orientation, given row by row, in plain floats: for a loop that runs it in every cycle."""
        (lx, ly, lz), table = self._plain
        r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_base_peg
        fx = lx * r00 + ly * r10 + lz * r20
        fy = lx * r01 + ly * r11 + lz * r21
        fz = lx * r02 + ly * r12 + lz * r22
        return [bias + a * fx + b * fy + c * fz for bias, a, b, c in table]

    def on_peg(self, raw: ArrayLike) -> Array:
        """Raw readings (..., 6) as wrenches on the peg, peg frame, N and Nm; `load` still in them.

        A loop can keep `load` while the orientation stays, and subtract it to get the contact wrench.
        Raises ValueError for a reading that is not finite: a comparison with a limit would treat it as small.
        """
        given = np.asarray(raw, dtype=float)
        if not (isfinite(sum(given.tolist())) if given.ndim == 1 else bool(np.all(np.isfinite(given)))):
            raise ValueError("the sensor's reading is not finite")
        return np.asarray(given @ self.mounting.peg_of_raw.T, dtype=float)

    def contact(self, raw: ArrayLike, rotation_base_peg: ArrayLike) -> Array:
        """The contact wrench (..., 6) on the peg, N and Nm, peg frame, about its origin, of raw readings (..., 6).

        `rotation_base_peg` is (3, 3) for all readings or (..., 3, 3) one each.
        """
        return np.asarray(self.on_peg(raw) - self.load(rotation_base_peg), dtype=float)
