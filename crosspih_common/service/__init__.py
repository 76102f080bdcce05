"""The life of a service: configuration, bus, status, signals, and a clean end."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crosspih_common.service.lifecycle import ServiceContext, run_service
else:

    def __getattr__(name: str) -> object:
        """Import on first use (PEP 562): the router only notifies the launcher, and needs nothing else from here."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = getattr(import_module(f"{__name__}.lifecycle"), name)
        globals()[name] = found
        return found


__all__ = ["ServiceContext", "run_service"]
