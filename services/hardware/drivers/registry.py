"""Which driver opens which device, by name. A driver's code is imported only when it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from services.hardware.config import DEVICES, HardwareConfig
from services.hardware.protocols import Devices

# name: "module:function"; the function takes an OpenRequest and returns Devices
DRIVERS = {
    "pictures": "services.hardware.drivers.pictures.opening:open_devices",
    "recorded": "services.hardware.drivers.recorded.opening:open_devices",
    "ros2": "services.hardware.drivers.ros2.opening:open_devices",
    "simulated": "services.hardware.drivers.simulated.cell:open_devices",
}


@dataclass(frozen=True, slots=True)
class OpenRequest:
    """What a driver is told: the cell, the options of its file, and which devices to open (names of `DEVICES`)."""

    workcell: Workcell
    config: HardwareConfig
    wanted: frozenset[str]
    realtime: bool

    @property
    def options(self) -> dict[str, Any]:
        """`hardware.options` of the cell's file: the driver's own, as it likes."""
        return self.config.options


Opener = Callable[[OpenRequest], Devices]


def opener(name: str) -> Opener:
    """A driver's function: one of `DRIVERS`, or any "module:function". Raises ConfigError naming what is not found."""
    target = DRIVERS.get(name, name)
    module_name, separator, function_name = target.partition(":")
    if not separator:
        names = ", ".join(sorted(DRIVERS))
        raise ConfigError(f'hardware.driver: no driver {name!r}; want {names}, or your own "module:function"')
    try:
        function: Opener = getattr(import_module(module_name), function_name)
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"hardware.driver: {target} cannot be loaded ({error}); is it installed beside crosspih?"
        ) from None
    return function


def open_devices(workcell: Workcell, config: HardwareConfig, wanted: frozenset[str], realtime: bool) -> Devices:
    """Open the wanted devices, each by the driver that the cell's file names for it.

    Drivers may be mixed: a simulated arm with a camera of your own. Raises ConfigError; what was opened is closed.
    """
    drivers: dict[str, set[str]] = {}
    for device in DEVICES:
        if device in wanted:
            drivers.setdefault(config.driver_of(device), set()).add(device)
    if "arm" in wanted and config.driver_of("arm") != config.driver_of("force_torque") and "force_torque" not in wanted:
        raise ConfigError("--devices: the arm and its force/torque sensor run in one loop; name both, arm,force_torque")
    found = Devices(realtime=realtime)
    closers: list[Callable[[], None]] = []

    def close() -> None:
        while closers:
            closers.pop()()

    try:
        for name, devices in drivers.items():
            opened = opener(name)(OpenRequest(workcell, config, frozenset(devices), realtime))
            closers.append(opened.close)
            _take_over(found, opened, name, devices)
    except BaseException:
        close()
        raise
    found.close = close
    return found


def _take_over(found: Devices, opened: Devices, name: str, devices: set[str]) -> None:
    given = {"arm": opened.joints, "force_torque": opened.wrench, "camera": opened.camera}
    for device in sorted(devices):
        if given[device] is None:
            raise ConfigError(f"hardware.drivers.{device}: {name} opens no {device}; name another driver for it")
    if "arm" in devices:
        found.joints, found.simulation, found.realtime = opened.joints, opened.simulation, opened.realtime
        found.landing = opened.landing
    if "force_torque" in devices:
        found.wrench = opened.wrench
    if "camera" in devices:
        found.camera = opened.camera
