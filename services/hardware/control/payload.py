"""What hangs behind the sensor, taken off its readings so that thresholds, caps and admittance see contact only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import SetPayload


@dataclass(frozen=True, slots=True, eq=False)
class Payload:
    """What is taken off a reading to see contact only: bias, and a weight at a centroid.

    bias (6,), weight_base_n (3,) in the base frame, centroid_m (3,) in the peg frame.
    """

    bias: Array
    weight_base_n: Array
    centroid_m: Array

    @classmethod
    def from_command(cls, command: SetPayload) -> Payload:
        """From a SetPayload; its gravity need not be of unit length."""
        down = np.asarray(command.gravity_base, float)
        return cls(
            np.asarray(command.bias, float),
            down / np.linalg.norm(down) * command.weight_n,
            np.asarray(command.centroid_ft_m, float),
        )

    @classmethod
    def tare(cls, reading: Array) -> Payload:
        """All of a reading (6,) is bias: right as long as the orientation stays."""
        return cls(np.array(reading, dtype=float), np.zeros(3), np.zeros(3))

    def load(self, rotation_base_peg: Array) -> Array:
        """The reading (6,) without contact at an orientation (3, 3)."""
        fx, fy, fz = self.weight_base_n @ rotation_base_peg
        x, y, z = self.centroid_m
        weight = np.array([fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx])
        return np.asarray(self.bias + weight)
