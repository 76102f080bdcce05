"""Which drivers there are: ours and those of installed packages, whether each can be imported, and what is missing."""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from importlib import import_module
from typing import Any

from crosspih_common.errors import ConfigError
from services.hardware.config import DEVICES
from services.hardware.drivers.registry import DRIVERS, opener, package_of, plugins, shadowed

OURS = "crosspih"


@dataclass(frozen=True, slots=True)
class Listed:
    """A driver. `opens` is empty where it does not tell; `missing` is what keeps it from being used, with the mend."""

    name: str
    package: str
    target: str
    opens: tuple[str, ...]
    usable: bool
    missing: str
    address: str

    def as_json(self) -> dict[str, Any]:
        """For `--json`."""
        return asdict(self)


def drivers() -> list[Listed]:
    """All, ours first, each imported to see whether it can be."""
    return [*(_ours(name) for name in sorted(DRIVERS)), *_theirs()]


def _ours(name: str) -> Listed:
    known = DRIVERS[name]
    wanting = [package for package, module in known.packages if not _importable(module)]
    said = f"{', '.join(wanting)}: pip install 'crosspih[{known.extra}]'" if wanting else ""
    if not said:
        try:
            opener(name)
        except ConfigError as error:
            said = str(error)
    return Listed(name, OURS, known.target, tuple(known.opens.split()), not said, said, known.address)


def _theirs() -> list[Listed]:
    """A plugin may say what it opens by an attribute of its function: `open_devices.opens = ("camera",)`."""
    found = []
    every = plugins()
    for one in every:
        opens: tuple[str, ...] = ()
        said = shadowed(one.name)
        if not said and sum(other.name == one.name for other in every) > 1:
            said = f'another package has a driver of that name; write "{one.value}"'
        if not said:
            try:
                opens = tuple(name for name in getattr(opener(one.name), "opens", ()) if name in DEVICES)
            except ConfigError as error:
                said = str(error)
        found.append(Listed(one.name, package_of(one), one.value, opens, not said, said, ""))
    return found


def _importable(module: str) -> bool:
    if module in sys.modules:
        return True
    try:
        import_module(module)
    except ImportError:
        return False
    return True
