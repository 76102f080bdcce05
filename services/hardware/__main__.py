"""`python -m services.hardware [--devices arm,force_torque]`: the cell's devices on the bus, all or some of them.

The arm and the sensor in its wrist run in one loop, in one process. A process with the camera alone is called `camera`
on the bus. Without `--devices` it hosts what `hardware.devices` of the cell's file says, which is all. With `--check`
it hosts nothing: it says whether the devices are there.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys

from crosspih_common.config import load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.modules import DEFAULT_CELL
from crosspih_common.service import ServiceContext, run_service
from crosspih_common.service.ending import end_process
from services.hardware.checking import print_check
from services.hardware.config import DEVICES, HardwareConfig, with_calibration_beside
from services.hardware.hosting import open_cell
from services.hardware.shells.hardware import HardwareShell


def wanted_devices(text: str) -> frozenset[str]:
    """The devices of a list with commas. Raises argparse.ArgumentTypeError naming what is no device."""
    names = {name.strip() for name in text.split(",") if name.strip()}
    unknown = sorted(names - set(DEVICES))
    if unknown or not names:
        raise argparse.ArgumentTypeError(f"{', '.join(unknown) or 'nothing'}: want some of {', '.join(DEVICES)}")
    if ("arm" in names) != ("force_torque" in names):
        raise argparse.ArgumentTypeError("the arm and its force/torque sensor run in one loop: name both or neither")
    return frozenset(names)


def build(context: ServiceContext, config: HardwareConfig, wanted: frozenset[str] | None) -> HardwareShell:
    """Open the wanted devices, or without any those that the configuration names, and bind them to their keys."""
    config = with_calibration_beside(config, context.cell.path)
    if wanted is None:
        wanted = wanted_devices(",".join(config.devices))
    speed = os.environ.get("CROSSPIH_SPEED") or config.simulated.speed
    if speed not in ("realtime", "max"):
        raise ConfigError(f"CROSSPIH_SPEED={speed}: want realtime or max")
    cell = open_cell(context.cell.workcell, config, speed == "realtime", wanted, context.event)
    shell = HardwareShell(cell, context)
    # what is there now stays: looked through for garbage, it would hold the arm's loop up for 50 ms
    gc.collect()
    gc.freeze()
    return shell


def check(wanted: frozenset[str] | None, arguments: list[str]) -> int:
    """Whether the devices are there; see checking.py."""
    parser = argparse.ArgumentParser(prog="python -m services.hardware --check")
    parser.add_argument("--cell", default=os.environ.get("CROSSPIH_CELL") or DEFAULT_CELL, help="the cell's YAML file")
    try:
        return print_check(load_cell(parser.parse_args(arguments).cell), wanted, realtime=True)
    except ConfigError as error:
        print(error, file=sys.stderr)
        return 2


def main() -> int:
    """Run the service."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--devices", type=wanted_devices, default=None)
    parser.add_argument("--check", action="store_true")
    chosen, others = parser.parse_known_args()
    wanted: frozenset[str] | None = chosen.devices
    if chosen.check:
        return check(wanted, others)
    # the loop must not wait 5 ms for a thread that only formats messages
    sys.setswitchinterval(0.001)
    name = "hardware" if wanted is None or "arm" in wanted else "camera"
    return run_service(
        name, HardwareConfig, lambda context, config: build(context, config, wanted), others, section="hardware"
    )


if __name__ == "__main__":
    end_process(main())
