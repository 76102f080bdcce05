"""Which driver opens the cell, by name. A driver's code is imported only when it is asked for."""

from __future__ import annotations

from importlib import import_module

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from services.hardware.config import HardwareConfig
from services.hardware.protocols import Cell

# name: "module:function"; the function takes (workcell, config, realtime) and returns a Cell
DRIVERS = {"simulated": "services.hardware.drivers.simulated.cell:open_cell"}


def open_cell(workcell: Workcell, config: HardwareConfig, realtime: bool) -> Cell:
    """Open the cell's devices by the driver that the configuration names, one of `DRIVERS` or any "module:function".

    Raises ConfigError naming what cannot be found.
    """
    target = DRIVERS.get(config.driver, config.driver)
    module_name, separator, function_name = target.partition(":")
    if not separator:
        names = ", ".join(sorted(DRIVERS))
        raise ConfigError(f'hardware.driver: no driver {config.driver!r}; want {names}, or your own "module:function"')
    try:
        function = getattr(import_module(module_name), function_name)
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"hardware.driver: {target} cannot be loaded ({error}); is it installed beside crosspih?"
        ) from None
    cell: Cell = function(workcell, config, realtime)
    return cell
