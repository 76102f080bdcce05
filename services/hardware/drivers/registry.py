"""Which driver opens which device, by name. A driver's code is imported only when it is asked for.

A name is looked for in `DRIVERS`, then among the entry points `crosspih.drivers` of what is installed; anything with a
colon is "module:function". The function takes an OpenRequest and returns Devices.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.messages import Severity
from services.hardware.config import DEVICES, HardwareConfig
from services.hardware.on_arms_clock import CellStampedWrench, TimedJoints
from services.hardware.protocols import Devices

GROUP = "crosspih.drivers"  # of entry points, of third-party packages
OWN = ("crosspih_common", "services")


@dataclass(frozen=True, slots=True)
class BuiltIn:
    """A driver of ours: its "module:function", the devices that it opens, and the extra and packages that it needs.

    `packages` are what the extra installs, each with the module that is imported of it: "ur-rtde": "rtde_control".
    `address` is the setting that says where the device is, below `hardware`: `crosspih cell init` asks for it.
    """

    target: str
    opens: str = "arm force_torque camera"
    extra: str = ""
    packages: tuple[tuple[str, str], ...] = ()
    address: str = ""


ARM, SENSOR, CAMERA = "arm force_torque", "force_torque", "camera"
HERE = "services.hardware.drivers"
# a line a driver: name, target, what it opens, extra, its packages, the setting of its address
DRIVERS: dict[str, BuiltIn] = {
    "ati": BuiltIn(f"{HERE}.ati.opening:open_devices", SENSOR, address="ati.host"),
    "genicam": BuiltIn(f"{HERE}.genicam.opening:open_devices", CAMERA, address="genicam.left"),
    "pictures": BuiltIn(f"{HERE}.pictures.opening:open_devices", CAMERA, address="pictures.calibration"),
    "recorded": BuiltIn(f"{HERE}.recorded.opening:open_devices", address="recorded.file"),
    "robotiq": BuiltIn(
        f"{HERE}.robotiq.opening:open_devices",
        SENSOR,
        "robotiq",
        (("pymodbus", "pymodbus"), ("pyserial", "serial")),
        address="robotiq.serial",
    ),
    "ros2": BuiltIn(f"{HERE}.ros2.opening:open_devices", extra="ros2", packages=(("rosbags", "rosbags"),)),
    "simulated": BuiltIn(f"{HERE}.simulated.cell:open_devices"),
    "ur": BuiltIn(f"{HERE}.ur.opening:open_devices", ARM, address="ur.host"),
    "video": BuiltIn(f"{HERE}.video.opening:open_devices", CAMERA, address="video.calibration"),
}


Tell = Callable[[Severity, str, str], None]


def print_on_standard_error(severity: Severity, code: str, text: str) -> None:
    """How devices tell of themselves where nobody else listens."""
    print(f"{severity.value}: {code}: {text}", file=sys.stderr, flush=True)


@dataclass(frozen=True, slots=True)
class OpenRequest:
    """What a driver is told: the cell, the options of its file, and which devices to open (names of `DEVICES`).

    `tell` is for what people should know of a device that is open: severity, a stable code, a text with the mend. Any
    thread may call it; what it says becomes an event of the service. It is no place for what happens many times a
    second.
    """

    workcell: Workcell
    config: HardwareConfig
    wanted: frozenset[str]
    realtime: bool
    tell: Tell = print_on_standard_error

    @property
    def options(self) -> dict[str, Any]:
        """`hardware.options` of the cell's file: the driver's own, as it likes."""
        return self.config.options


Opener = Callable[[OpenRequest], Devices]


def plugins(name: str | None = None) -> list[EntryPoint]:
    """The entry points of third-party drivers, or those of one name, in the order of their names."""
    found = entry_points(group=GROUP) if name is None else entry_points(group=GROUP, name=name)
    return sorted(found, key=lambda one: (one.name, one.value))


def package_of(plugin: EntryPoint) -> str:
    """The distribution that an entry point stands in."""
    return "an unnamed package" if plugin.dist is None else plugin.dist.name


def shadowed(name: str) -> str:
    """What is to be said of plugins that have the name of a driver of ours, which goes first; empty without any."""
    others = plugins(name) if name in DRIVERS else []
    if not others:
        return ""
    return (
        f"{name} is crosspih's own driver; that of {', '.join(package_of(one) for one in others)} has the same name "
        f'and is not used: to have it write "{others[0].value}"'
    )


def opener(name: str) -> Opener:
    """A driver's function: one of `DRIVERS`, a plugin's, or any "module:function".

    Raises ConfigError naming what is not found and the mend.
    """
    if name in DRIVERS:
        if note := shadowed(name):
            print(f"hardware.driver: {note}", file=sys.stderr, flush=True)
        return _imported(name, DRIVERS[name].target)
    if ":" in name:
        return _imported(name, name)
    found = plugins(name)
    if len(found) > 1:
        raise ConfigError(
            f"hardware.driver: {name} is a driver of {' and of '.join(package_of(one) for one in found)}; write which "
            f"is meant: {' or '.join(repr(one.value) for one in found)}"
        )
    if found:
        return _plugged(found[0])
    names = ", ".join(sorted({*DRIVERS, *(one.name for one in plugins())}))
    raise ConfigError(
        f'hardware.driver: no driver {name!r}; want {names}, or your own "module:function"; `crosspih cell drivers` '
        "lists them"
    )


def missing(name: str, error: ImportError) -> str:
    """The sentence for a package that a driver of ours cannot be without; empty where it is none of its packages."""
    known = DRIVERS.get(name)
    if known is None or not known.extra or (error.name or "").split(".")[0] in OWN:
        return ""
    wanted = dict((module, package) for package, module in known.packages)
    package = wanted.get(error.name or "", "") or ", ".join(package for package, _ in known.packages) or error.name
    return f"hardware.driver: {name} needs {package}: pip install 'crosspih[{known.extra}]' ({error})"


def _imported(name: str, target: str) -> Opener:
    module_name, _, function_name = target.partition(":")
    try:
        function = getattr(import_module(module_name), function_name)
    except ImportError as error:
        raise ConfigError(
            missing(name, error)
            or f"hardware.driver: {target} cannot be loaded ({error}); is it installed beside crosspih?"
        ) from None
    except AttributeError as error:
        raise ConfigError(
            f"hardware.driver: {target} cannot be loaded ({error}); is it installed beside crosspih?"
        ) from None
    return _called(target, function)


def _plugged(plugin: EntryPoint) -> Opener:
    where = f"{plugin.name} of {package_of(plugin)} ({plugin.value})"
    try:
        function = plugin.load()
    except Exception as error:
        # whatever its module does at import, the cell must be told whose it is
        raise ConfigError(
            f"hardware.driver: {where} cannot be loaded ({type(error).__name__}: {error}); install what it needs, or "
            f"mend that package: pip install --force-reinstall {package_of(plugin)}"
        ) from None
    return _called(where, function)


def _called(where: str, function: Any) -> Opener:
    if not callable(function):
        raise ConfigError(
            f"hardware.driver: {where} is {type(function).__name__}, want a function that takes an OpenRequest"
        )
    opened: Opener = function
    return opened


def open_devices(
    workcell: Workcell, config: HardwareConfig, wanted: frozenset[str], realtime: bool,
    tell: Tell = print_on_standard_error,
) -> Devices:  # fmt: skip
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
            opened = _opened(name, OpenRequest(workcell, config, frozenset(devices), realtime, tell))
            closers.append(opened.close)
            _take_over(found, opened, name, devices)
    except BaseException:
        close()
        raise
    found.close = close
    _on_one_clock(found)
    return found


def _on_one_clock(found: Devices) -> None:
    """The stamps of the joints are the cell's clock; a sensor of another driver that has this machine's is put on
    it."""
    if found.host_stamped and found.joints is not None and found.wrench is not None:
        joints = TimedJoints(found.joints)
        found.joints, found.wrench = joints, CellStampedWrench(found.wrench, joints)


def _opened(name: str, request: OpenRequest) -> Devices:
    """Raises ConfigError, also for a package that is imported only now, and for what is no driver."""
    function = opener(name)
    try:
        opened = function(request)
    except ImportError as error:
        if said := missing(name, error):
            raise ConfigError(said) from None
        raise
    if not isinstance(opened, Devices):
        raise ConfigError(
            f"hardware.driver: {name} returned {type(opened).__name__}; want services.hardware.protocols.Devices"
        )
    return opened


def _take_over(found: Devices, opened: Devices, name: str, devices: set[str]) -> None:
    given = {"arm": opened.joints, "force_torque": opened.wrench, "camera": opened.camera}
    for device in sorted(devices):
        if given[device] is None:
            raise ConfigError(f"hardware.drivers.{device}: {name} opens no {device}; name another driver for it")
    if "arm" in devices:
        found.joints, found.simulation, found.realtime = opened.joints, opened.simulation, opened.realtime
        found.landing = opened.landing
    if "force_torque" in devices:
        found.wrench, found.host_stamped = opened.wrench, opened.host_stamped
    if "camera" in devices:
        found.camera = opened.camera
