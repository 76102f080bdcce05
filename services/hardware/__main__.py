"""`python -m services.hardware`: the cell's devices on the bus."""

from __future__ import annotations

import sys

from crosspih_common.service import ServiceContext, run_service
from services.hardware.config import HardwareConfig
from services.hardware.drivers import open_cell
from services.hardware.shell import HardwareShell


def build(context: ServiceContext) -> HardwareShell:
    """Open the cell that the configuration names and bind it to its keys."""
    config = context.cell.section("hardware", HardwareConfig)
    cell = open_cell(context.cell.workcell, config)
    return HardwareShell(cell, context, realtime=config.realtime)


if __name__ == "__main__":
    sys.exit(run_service("hardware", build))
