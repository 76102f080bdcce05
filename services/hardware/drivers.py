"""Which driver opens the cell, by name. A driver's code is imported only when it is asked for."""

from __future__ import annotations

from importlib import import_module

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from services.hardware.config import HardwareConfig
from services.hardware.protocols import Cell

# name: "module:function"; the function takes (workcell, config, realtime) and returns a Cell
DRIVERS = {"simulated": "services.hardware.simulation.cell:open_cell"}


def open_cell(workcell: Workcell, config: HardwareConfig, realtime: bool) -> Cell:
    """Open the cell's devices. Raises ConfigError on an unknown driver."""
    target = DRIVERS.get(config.driver)
    if target is None:
        raise ConfigError(f"hardware.driver: no driver {config.driver!r}; want one of {', '.join(sorted(DRIVERS))}")
    module, function = target.split(":")
    cell: Cell = getattr(import_module(module), function)(workcell, config, realtime)
    return cell
