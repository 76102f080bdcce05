"""What the simulated F/T sensor gives out."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.config import SimulatedSensorConfig

_BLOCK = 512


class SensorModel:
    """An ideal sensor at 1 kHz made real: its own low-pass, then bias, white noise and drift."""

    def __init__(self, config: SimulatedSensorConfig) -> None:
        self._bias = np.asarray(config.bias, float)
        self._sd = np.repeat([config.noise_n, config.noise_nm], 3)
        self._drift_per_s = np.repeat([config.drift_n_s, 0.0], 3) if config.drift_n_s else None
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
        drifted: Array = self._filtered + self._bias
        if self._drift_per_s is not None:
            drifted = drifted + self._drift_per_s * since_start_s
        reading: Array = drifted + noise
        return reading
