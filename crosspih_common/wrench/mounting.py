"""How a force/torque sensor is mounted and how its numbers are to be read.

Three forms: *raw* is the driver's reading in its own units, axes and sign; *sensor* is the same load in N and Nm in the
sensor's frame {K}, as the load on the peg; *peg* is that load about the peg frame's origin.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array, Pose
from crosspih_common.geometry.wrench import adjoint_wrench


@dataclass(frozen=True, slots=True, eq=False)
class SensorMounting:
    """From raw readings to wrenches on the peg, and back; the default is a sensor in the peg frame with N and Nm.

    pose_peg_sensor: the sensor's frame in the peg frame. sign: +1 if the sensor reports the load on the peg, -1
    if it reports the reaction. axes (3, 3): the proper rotation that takes the three reported numbers to x, y, z of
    the sensor's frame. n_per_unit, nm_per_unit: what one reported unit of force is in N, one of moment in Nm.

    sensor_of_raw, peg_of_sensor, peg_of_raw (6, 6) follow, and the ways back raw_of_sensor, sensor_of_peg.
    Raises ValueError naming the field that cannot be.
    """

    pose_peg_sensor: Pose = field(default_factory=Pose.identity)
    sign: int = 1
    axes: Array = field(default_factory=lambda: np.eye(3))
    n_per_unit: float = 1.0
    nm_per_unit: float = 1.0
    sensor_of_raw: Array = field(init=False)
    peg_of_sensor: Array = field(init=False)
    peg_of_raw: Array = field(init=False)
    raw_of_sensor: Array = field(init=False)
    sensor_of_peg: Array = field(init=False)

    def __post_init__(self) -> None:
        axes = np.asarray(self.axes, dtype=float)
        if self.sign not in (1, -1):
            raise ValueError(f"sign wants 1 (load on the peg) or -1 (reaction), got {self.sign}")
        if axes.shape != (3, 3) or not np.allclose(axes @ axes.T, np.eye(3), atol=1e-6) or np.linalg.det(axes) < 0.0:
            raise ValueError("axes wants a (3, 3) rotation matrix: right-handed, without scale")
        if not 0.0 < self.n_per_unit < np.inf or not 0.0 < self.nm_per_unit < np.inf:
            raise ValueError(f"units want factors above 0, got {self.n_per_unit} N and {self.nm_per_unit} Nm")
        sensor_of_raw = np.zeros((6, 6))
        sensor_of_raw[:3, :3] = self.sign * self.n_per_unit * axes
        sensor_of_raw[3:, 3:] = self.sign * self.nm_per_unit * axes
        peg_of_sensor = adjoint_wrench(self.pose_peg_sensor)
        object.__setattr__(self, "axes", axes)
        object.__setattr__(self, "sensor_of_raw", sensor_of_raw)
        object.__setattr__(self, "peg_of_sensor", peg_of_sensor)
        object.__setattr__(self, "peg_of_raw", peg_of_sensor @ sensor_of_raw)
        object.__setattr__(self, "raw_of_sensor", np.linalg.inv(sensor_of_raw))
        object.__setattr__(self, "sensor_of_peg", adjoint_wrench(self.pose_peg_sensor.inverse()))

    def sensor(self, raw: ArrayLike) -> Array:
        """The wrenches (..., 6), N and Nm, sensor frame, of raw readings (..., 6); bias and weight still in them."""
        return np.asarray(np.asarray(raw, dtype=float) @ self.sensor_of_raw.T, dtype=float)

    def sensor_sd(self, raw_sd: ArrayLike) -> Array:
        """The standard deviations (..., 6), sensor frame, of independent ones (..., 6) of raw readings."""
        return _spread(self.sensor_of_raw, raw_sd)

    def peg_sd(self, raw_sd: ArrayLike) -> Array:
        """The same (..., 6) of the wrench on the peg, peg frame."""
        return _spread(self.peg_of_raw, raw_sd)

    def raw(self, wrench_peg: ArrayLike) -> Array:
        """The raw readings (..., 6) for wrenches (..., 6) on the peg, peg frame: the inverse."""
        sensor = np.asarray(wrench_peg, dtype=float) @ self.sensor_of_peg.T
        return np.asarray(sensor @ self.raw_of_sensor.T, dtype=float)

    def rotation_base_sensor(self, rotation_base_peg: ArrayLike) -> Array:
        """The sensor's orientation (..., 3, 3) for orientations of the peg frame (..., 3, 3)."""
        rotation = np.asarray(rotation_base_peg, dtype=float) @ self.pose_peg_sensor.rotation
        return np.asarray(rotation, dtype=float)


def _spread(matrix: Array, sd: ArrayLike) -> Array:
    variance = np.asarray(sd, dtype=float) ** 2 @ (matrix**2).T
    return np.asarray(np.sqrt(variance), dtype=float)
