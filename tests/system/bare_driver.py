"""A driver of a cell that nobody can reset and that tells no truth, as a real one: the simulated devices alone."""

from __future__ import annotations

import dataclasses

from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.simulated.cell import open_devices as open_simulated
from services.hardware.protocols import Devices


def open_devices(request: OpenRequest) -> Devices:
    """Arm, sensor and cameras, without the simulation behind them."""
    return dataclasses.replace(open_simulated(request), simulation=None)
