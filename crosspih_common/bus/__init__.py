"""The typed bus: publish, subscribe, command and liveliness over Zenoh, or in memory for unit tests."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crosspih_common.bus.bus import Bus, Latest, Publisher
    from crosspih_common.bus.memory import MemoryHub
    from crosspih_common.bus.zenoh_transport import ALIVE_LEASE_MS, DEFAULT_ENDPOINT, open_zenoh
else:
    _MODULES = {
        "ALIVE_LEASE_MS": "zenoh_transport",
        "Bus": "bus",
        "DEFAULT_ENDPOINT": "zenoh_transport",
        "Latest": "bus",
        "MemoryHub": "memory",
        "Publisher": "bus",
        "open_zenoh": "zenoh_transport",
    }

    def __getattr__(name: str) -> object:
        """Import each name when it is first used (PEP 562): the router needs the transport alone, and restarts faster
        without SciPy, which the messages load."""
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        globals()[name] = found
        return found


__all__ = [
    "ALIVE_LEASE_MS",
    "DEFAULT_ENDPOINT",
    "Bus",
    "Latest",
    "MemoryHub",
    "Publisher",
    "open_zenoh",
]
