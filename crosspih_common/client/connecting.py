"""Opening a client: `with connect() as cell`."""

from __future__ import annotations

from pathlib import Path

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.client import defaults
from crosspih_common.client.cell import NEEDED, Cell
from crosspih_common.config import CellFile, load_cell

OPERATOR = "operator"  # a client acts as the operator: it has the same rights as the CLI
CONNECT_S = 5.0


def connect(
    endpoint: str | None = None,
    cell: str | Path | None = None,
    *,
    timeout_s: float = CONNECT_S,
    needed: tuple[str, ...] = NEEDED,
) -> Cell:
    """Connect to the bus of the running cell; use it in a `with` block, which closes it.

    `endpoint` is the router, such as "tcp/127.0.0.1:7447" (CROSSPIH_ENDPOINT, or the one of this machine, where left
    out); `cell` the cell's file (CROSSPIH_CELL, or the default cell's); `timeout_s` the wall time that the router and
    the `needed` services have to answer. Where CROSSPIH_CERTIFICATES names a folder the operator's certificate is used.

    Raises BusUnreachable where no router answers and NoService where a service is missing, each in one line that says
    what to do; ConfigError where the cell's file is wrong; CommandRefused `cell_unfit` where two cells tick.
    """
    opened = open_cell(endpoint, cell, timeout_s=timeout_s, readings=True)
    try:
        opened.wait_for_services(timeout_s, needed)
        opened.require_sound_cell()
    except BaseException:
        opened.close()
        raise
    return opened


def open_cell(endpoint: str | None, cell: str | Path | None, *, timeout_s: float, readings: bool) -> Cell:
    """Connect without waiting for any service. Raises BusUnreachable, ConfigError."""
    return Cell(*open_bus(endpoint, cell, timeout_s), readings=readings)


def open_bus(endpoint: str | None, cell: str | Path | None, timeout_s: float) -> tuple[Bus, CellFile]:
    """The bus with the operator's rights, and the cell's file. Raises BusUnreachable, ConfigError."""
    file = load_cell(cell or defaults.cell_path())
    return Bus(open_zenoh(endpoint or defaults.endpoint(), timeout_s, OPERATOR), file.workcell.name, OPERATOR), file
