"""Loads a user's own code by name: `my_lab.mine:Strategy`, or a name that an installed package declares.

A service loads only what its Python can import (its environment, and the PYTHONPATH that it was started with). The name
comes from the cell's file, or the cell's file must allow it (docs/security.md).
"""

from __future__ import annotations

import hashlib
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from crosspih_common.errors import ConfigError


def declared(group: str) -> list[EntryPoint]:
    """The entry points of a group that installed packages declare, sorted by name."""
    return sorted(entry_points(group=group), key=lambda one: (one.name, one.value))


def target_of(what: str, name: str, group: str = "") -> str:
    """The `module:attribute` that a name stands for: itself, or that of an entry point of the group.

    Raises ConfigError, which begins with `what` (such as "strategy"), naming what there is.
    """
    module, colon, attribute = name.partition(":")
    if colon:
        if not module or not attribute:
            raise ConfigError(f"{what} {name}: want module:name, such as my_lab.mine:Strategy")
        return name
    known = {one.name: one.value for one in declared(group)} if group else {}
    if name in known:
        return known[name]
    offered = f"; installed packages declare {', '.join(known)}" if known else ""
    raise ConfigError(f"{what} {name}: no such name; write your own as module:name, such as my_lab.mine:Own{offered}")


def load(what: str, name: str, group: str = "") -> Any:
    """The object of that name. Raises ConfigError where it cannot be imported, with Python's reason and the mend."""
    target = target_of(what, name, group)
    module, _, attribute = target.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except AttributeError:
        raise ConfigError(f"{what} {name}: module {module} has no {attribute}") from None
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"{what} {name}: no module {error.name} where the service runs; install it there, or start the stack with "
            "its folder in PYTHONPATH"
        ) from None
    except Exception as error:  # the user's module may raise anything while it is loaded
        raise ConfigError(f"{what} {name}: {module} cannot be loaded: {type(error).__name__}: {error}") from error


def content_digest(what: str, name: str, group: str = "") -> str:
    """A hash of the source behind a name: the module's file, or for a module in a package all files of the outermost
    package. Sixteen hex digits; only the packages' `__init__` is run. Raises ConfigError."""
    module = target_of(what, name, group).partition(":")[0]
    try:
        spec = find_spec(module)
        outermost = find_spec(module.partition(".")[0])
    except (ImportError, ValueError) as error:
        raise ConfigError(f"{what} {name}: {module} cannot be found ({error}); put its folder in PYTHONPATH") from None
    if spec is None or outermost is None:
        raise ConfigError(f"{what} {name}: no module {module} here; put its folder in PYTHONPATH")
    folders = list(outermost.submodule_search_locations or ())
    files = sorted({file for folder in folders for file in Path(folder).rglob("*") if file.suffix in SOURCES})
    if not folders and spec.origin is not None:
        files = [Path(spec.origin)]
    digest = hashlib.sha256(name.encode())
    for file in files:
        digest.update(file.name.encode() + b"\n" + file.read_bytes())
    return digest.hexdigest()[:16]


SOURCES = (".py", ".json", ".yaml", ".npz", ".npy", ".safetensors", ".pt", ".onnx")
