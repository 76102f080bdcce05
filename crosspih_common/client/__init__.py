"""Work with a running cell from a program or a notebook: `cell = connect()`, then `cell.assemble(seed=7)`.

`connect` gives a `Cell`, `connect_async` an `AsyncCell` with the same methods as awaitables. `Recording` reads a
recording. docs/client.md shows all of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crosspih_common.client.asynchronous import AsyncCell, AsyncStream, connect_async
    from crosspih_common.client.cell import Cell
    from crosspih_common.client.connecting import connect
    from crosspih_common.client.outcomes import Assembly, CellStatus
    from crosspih_common.client.streaming import Stream
    from crosspih_common.recording import Recording
else:
    from importlib import import_module

    _MODULES = {
        "Assembly": "client.outcomes",
        "AsyncCell": "client.asynchronous",
        "AsyncStream": "client.asynchronous",
        "Cell": "client.cell",
        "CellStatus": "client.outcomes",
        "Recording": "recording",
        "Stream": "client.streaming",
        "connect": "client.connecting",
        "connect_async": "client.asynchronous",
    }

    def __getattr__(name: str) -> object:
        """Import each name when it is first used (PEP 562): commands that only need the defaults load no message."""
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = getattr(import_module(f"crosspih_common.{_MODULES[name]}"), name)
        globals()[name] = found
        return found


__all__ = [
    "Assembly",
    "AsyncCell",
    "AsyncStream",
    "Cell",
    "CellStatus",
    "Recording",
    "Stream",
    "connect",
    "connect_async",
]
