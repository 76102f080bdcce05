"""`python -m services.hardware`: the cell's devices on the bus."""

from __future__ import annotations

import os
import sys

from crosspih_common.errors import ConfigError
from crosspih_common.service import ServiceContext, run_service
from services.hardware.config import HardwareConfig
from services.hardware.drivers.registry import open_cell
from services.hardware.shell import HardwareShell


def build(context: ServiceContext) -> HardwareShell:
    """Open the cell that the configuration names and bind it to its keys."""
    config = context.cell.section("hardware", HardwareConfig)
    speed = os.environ.get("CROSSPIH_SPEED") or config.simulated.speed
    if speed not in ("realtime", "max"):
        raise ConfigError(f"CROSSPIH_SPEED={speed}: want realtime or max")
    realtime = speed == "realtime"
    return HardwareShell(open_cell(context.cell.workcell, config, realtime), context, realtime)


if __name__ == "__main__":
    sys.exit(run_service("hardware", build))
