"""All that the doctor looks at, in order."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from crosspih_common.bus import Bus
from crosspih_common.config import CellFile, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.messages import CameraCalibration, Strategy
from deploy.launcher.state import default_run_root
from services.operator.doctor import addresses, calibrations, clocks, devices, drawing, machine, network, software
from services.operator.doctor.row import Row, looked, ok, wrong
from services.operator.doctor.weights import weight_rows
from services.operator.session import NEEDED

RECORDINGS = "recordings"  # as services/recorder/config.py has it
HOLDER_TIMEOUT_S = 0.1  # as services/hardware/control/config.py has it
TOKENS_S = 0.5


@dataclass(frozen=True, slots=True)
class Wish:
    """What is to be examined. `temperature_c` is how warm it is at the cell now, where that is known."""

    cell: Path
    endpoint: str
    strategy: Strategy = Strategy.FUSED
    open_devices: bool = True
    temperature_c: float | None = None


def examine(wish: Wish, say: Callable[[str], None] = lambda text: None) -> list[Row]:
    """Every row."""
    say("Python and packages")
    rows = [software.python_row(), *looked("packages", software.package_rows), *looked("wheels", software.wheel_rows)]
    cell: CellFile | None = None
    try:
        cell = load_cell(wish.cell)
        rows.append(ok("cell file", f"{wish.cell}: cell {cell.workcell.name}"))
    except ConfigError as error:
        rows.append(wrong("cell file", str(error), "mend what it names; crosspih cell init makes a new file"))
    say("clocks")
    rows += looked("timer", lambda: clocks.clock_rows(_holder_timeout_s(cell)))
    recordings = RECORDINGS if cell is None else str(cell.sections.get("recorder", {}).get("directory", RECORDINGS))
    rows += looked("disk", lambda: machine.disk_rows(Path(recordings)))
    say("the router")
    found, bus = network.router_rows(wish.endpoint, "cell1" if cell is None else cell.workcell.name)
    rows += found
    try:
        if cell is not None:
            rows += _of_the_cell(wish, cell, bus, say)
    finally:
        if bus is not None:
            bus.close()
    return rows


def _of_the_cell(wish: Wish, cell: CellFile, bus: Bus | None, say: Callable[[str], None]) -> list[Row]:
    rows: list[Row] = []
    told: CameraCalibration | None = None
    alive: set[str] = set()
    if bus is not None:
        alive = _alive(bus)
        here = bus
        apart = "camera" not in devices.hosted(cell) and wish.strategy is not Strategy.FORCE_ALONE
        needed = (*NEEDED, "camera") if apart else NEEDED
        rows += looked("services", lambda: network.service_rows(here, alive, needed))
    say("devices")
    hardware: dict[str, Any] = cell.sections.get("hardware", {})
    hosts, files = addresses.addresses(hardware)
    used = devices.drivers_of(cell)
    rows += looked("addresses", lambda: addresses.address_rows(hosts))
    rows += looked("device files", lambda: machine.device_file_rows(files))
    rows += looked("receive buffer", lambda: machine.buffer_rows(used))
    if bus is not None and "hardware" in alive:
        running = bus
        rows += looked("devices", lambda: devices.running_rows(running, devices.hosted(cell)))
        told = devices.calibration_of(running)
    elif wish.open_devices:
        rows += looked("devices", lambda: devices.opened_rows(wish.cell))
    say("calibrations and drawings")
    now = datetime.now(timezone.utc)
    rows += looked("calibrations", lambda: calibrations.ft_rows(cell, now, wish.temperature_c))
    rows += looked("calibrations", lambda: calibrations.camera_rows(cell, used))
    rows += looked("calibrations", lambda: calibrations.other_rows(cell, now, wish.temperature_c, default_run_root()))
    rows += looked("drawings", lambda: drawing.fit_rows(cell.workcell))
    rows += looked("reach", lambda: drawing.reach_rows(cell.workcell))
    if wish.strategy is not Strategy.FORCE_ALONE:
        rows += looked("cameras", lambda: drawing.camera_rows(cell.workcell, told))
    rows += looked("networks", lambda: weight_rows(wish.strategy, cell.sections.get("inference", {})))
    return rows


def _alive(bus: Bus) -> set[str]:
    """The services whose tokens are there now."""
    living: set[str] = set()
    bus.watch_alive(lambda service, alive: (living.add if alive else living.discard)(service))
    time.sleep(TOKENS_S)  # tokens come at once, and nothing tells when all have come
    return set(living)


def _holder_timeout_s(cell: CellFile | None) -> float:
    limits = {} if cell is None else cell.sections.get("hardware", {}).get("limits") or {}
    said = limits.get("holder_timeout_s", HOLDER_TIMEOUT_S) if isinstance(limits, dict) else HOLDER_TIMEOUT_S
    return float(said) if isinstance(said, (int, float)) else HOLDER_TIMEOUT_S
