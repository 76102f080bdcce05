"""Which engine simulates the cell, by name. An engine's package is imported only when it is asked for."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.engines.protocol import Physics

AUTO = "auto"
# in the order that `auto` takes them; each has a folder here of its name, whose engine.py names its Physics ENGINE
ENGINES = ("pybullet", "mujoco")


def installed_engines() -> tuple[str, ...]:
    """The engines whose package is installed, in the order that `auto` takes them."""
    return tuple(name for name in ENGINES if find_spec(name) is not None)


def chosen_engine(name: str) -> str:
    """The engine that a name of the cell's file means: `auto` is the first that is installed.

    Raises ConfigError: a name that is none, or an engine that is not installed, with what to install.
    """
    if name not in (AUTO, *ENGINES):
        raise ConfigError(f"hardware.engine: no engine {name!r}; want {', '.join((AUTO, *ENGINES))}")
    have = installed_engines()
    if name == AUTO:
        if not have:
            raise ConfigError(
                "hardware.engine: no physics engine is installed; pip install 'crosspih[mujoco]', or "
                "'crosspih[pybullet]' with Python 3.11 or older"
            )
        return have[0]
    if name not in have:
        raise ConfigError(f"hardware.engine: {name} is not installed; {_mend(name, have)}")
    return name


def _mend(name: str, have: tuple[str, ...]) -> str:
    version = ".".join(map(str, sys.version_info[:2]))
    if name == "pybullet" and sys.version_info >= (3, 12):
        install = f"there is no ready-made pybullet for Python {version}, so use 3.11 or 3.10"
    else:
        install = f"pip install 'crosspih[{name}]'"
    return install + (f", or set hardware.engine to {have[0]} or auto" if have else "")


def open_engine(name: str, workcell: Workcell, config: SimulatedConfig) -> Physics:
    """A world in the engine of that name, or in the first that is installed for `auto`.

    Raises ConfigError: see `chosen_engine`.
    """
    module = import_module(f"{__package__}.{chosen_engine(name)}.engine")
    physics: Physics = module.ENGINE(workcell, config)
    return physics
