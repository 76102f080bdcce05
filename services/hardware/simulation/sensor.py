"""What the simulated F/T sensor gives out, and what the arm's controller makes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import SetPayload
from services.hardware.config import ForceTorqueConfig

_BLOCK = 512


class SensorModel:
    """An ideal sensor at 1 kHz made real: its own low-pass, then bias, white noise and drift."""

    def __init__(self, config: ForceTorqueConfig) -> None:
        self._bias = np.asarray(config.bias, float)
        self._sd = np.repeat([config.noise_n, config.noise_nm], 3)
        self._drift_per_s = np.repeat([config.drift_n_s, 0.0], 3)
        self._rng = np.random.default_rng(0)
        self._block = np.zeros((0, 6))
        self._next = 0
        self._smoothing = 1.0 - np.exp(-2.0 * np.pi * config.bandwidth_hz * 1e-3)
        self._filtered: Array | None = None

    def start(self, rng: np.random.Generator) -> None:
        """Begin a trial: noise from this generator, drift from zero, no memory."""
        self._rng = rng
        self._next = len(self._block)
        self._filtered = None

    def sample(self, ideal: Array, since_start_s: float) -> Array:
        """One reading (6,) of an ideal wrench (6,)."""
        if self._next >= len(self._block):
            self._block = self._rng.standard_normal((_BLOCK, 6)) * self._sd
            self._next = 0
        noise = self._block[self._next]
        self._next += 1
        if self._filtered is None:
            self._filtered = ideal
        self._filtered = self._filtered + self._smoothing * (ideal - self._filtered)
        return np.asarray(self._filtered + self._bias + self._drift_per_s * since_start_s + noise)


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
