"""All checks of the doctor, in order."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from crosspih_common.bus import Bus
from crosspih_common.config import CellFile, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.messages import CameraCalibration, Strategy
from deploy.launcher.state import default_run_root
from services.operator.assembly.session import NEEDED
from services.operator.cli.rows import Row, looked, ok, wrong
from services.operator.doctor import addresses, calibrations, clocks, devices, drawing, machine, network, software
from services.operator.doctor.sections import ReadSections, read_sections
from services.operator.doctor.weights import weight_rows

HOLDER_TIMEOUT_S = 0.1  # as in services/hardware/control/config.py, where the file cannot be read
TOKENS_S = 0.5
COMMANDS_NEED = (*NEEDED, "recorder")  # crosspih assemble records


@dataclass(frozen=True, slots=True)
class Wish:
    """The checks to make. `temperature_c` is the present temperature at the cell, where that is known."""

    cell: Path
    endpoint: str
    strategy: Strategy = Strategy.FUSED
    open_devices: bool = True
    temperature_c: float | None = None


def examine(wish: Wish, say: Callable[[str], None] = lambda text: None) -> list[Row]:
    """Every row. Checks that need a section which cannot be read are left out until that is mended."""
    say("Python and packages")
    rows = [software.python_row(), *looked("packages", software.package_rows), *looked("wheels", software.wheel_rows)]
    cell: CellFile | None = None
    read = ReadSections()
    try:
        cell = load_cell(wish.cell)
        rows.append(ok("cell file", f"{wish.cell}: cell {cell.workcell.name}"))
        say("what each service reads of the cell's file")
        read = read_sections(wish.cell, cell)
        rows += read.rows
    except ConfigError as error:
        rows.append(wrong("cell file", str(error), "mend what it names; crosspih cell init makes a new file"))
    say("clocks")
    limits = read.settings.get("hardware", {}).get("limits", {})
    rows += looked("timer", lambda: clocks.clock_rows(limits.get("holder_timeout_s", HOLDER_TIMEOUT_S)))
    if "recorder" in read.settings:
        rows += looked("disk", lambda: machine.disk_rows(Path(read.settings["recorder"]["directory"])))
    rows += looked("state of stacks", lambda: machine.state_rows(default_run_root()))
    say("the router")
    found, bus = network.router_rows(wish.endpoint, "cell1" if cell is None else cell.workcell.name)
    rows += found
    try:
        if cell is not None:
            rows += _of_the_cell(wish, cell, read, bus, say)
    finally:
        if bus is not None:
            bus.close()
    return rows


def _of_the_cell(
    wish: Wish, file: CellFile, read: ReadSections, bus: Bus | None, say: Callable[[str], None]
) -> list[Row]:
    rows: list[Row] = []
    alive: set[str] = set()
    cell, readable = read.filled(file), read.settings
    by_force = wish.strategy is Strategy.FORCE_ALONE
    if bus is not None:
        here = bus
        alive = _alive(bus)
        apart = "hardware" in readable and "camera" not in devices.hosted(cell) and not by_force
        needed = (*COMMANDS_NEED, "camera") if apart else COMMANDS_NEED
        rows += looked("services", lambda: network.service_rows(here, alive, needed))
        if "hardware" in alive:
            rows += looked("wall clock of the cell", lambda: network.cells_clock_rows(here))
    told: CameraCalibration | None = None
    if "hardware" in readable:
        say("devices")
        rows += _devices(wish, file, cell, bus, alive)
        told = devices.calibration_of(bus) if bus is not None and "hardware" in alive else None
    say("calibrations and drawings")
    now = datetime.now(timezone.utc)
    if "force_torque" in readable:
        rows += looked("calibrations", lambda: calibrations.ft_rows(cell, now, wish.temperature_c))
    if "hardware" in readable:
        rows += looked("calibrations", lambda: calibrations.camera_rows(cell, devices.drivers_of(cell)))
    rows += looked("calibrations", lambda: calibrations.other_rows(cell, now, wish.temperature_c, default_run_root()))
    rows += looked("drawings", lambda: drawing.fit_rows(cell.workcell))
    if "planning" in readable:
        rows += looked("reach", lambda: drawing.reach_rows(cell.workcell, readable["planning"]["approach_m"]))
    if not by_force:
        rows += looked("cameras", lambda: drawing.camera_rows(cell.workcell, told))
    if "inference" in readable:
        rows += looked("networks", lambda: weight_rows(wish.strategy, readable["inference"]))
    return rows


def _devices(wish: Wish, file: CellFile, cell: CellFile, bus: Bus | None, alive: set[str]) -> list[Row]:
    """`file` shows which addresses were written, `cell` has all settings."""
    hosts, files = addresses.addresses(file.sections["hardware"])
    rows = looked("addresses", lambda: addresses.address_rows(hosts))
    rows += looked("device files", lambda: machine.device_file_rows(files))
    rows += looked("receive buffer", lambda: machine.buffer_rows(devices.drivers_of(cell)))
    if bus is not None and "hardware" in alive:
        running = bus
        rows += looked("devices", lambda: devices.running_rows(running, devices.hosted(cell)))
    elif alive:
        rows.append(devices.not_opened_row(alive))
    elif wish.open_devices:
        rows += looked("devices", lambda: devices.opened_rows(wish.cell))
    return rows


def _alive(bus: Bus) -> set[str]:
    """The services whose tokens are there now."""
    living: set[str] = set()
    bus.watch_alive(lambda service, alive: (living.add if alive else living.discard)(service))
    time.sleep(TOKENS_S)  # tokens come at once, and nothing reports when all have come
    return set(living)
