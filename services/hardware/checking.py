"""`python -m services.hardware --check`: are the devices there? Opens them by the cell's drivers, and reads each.

Nothing is written to an arm. For `crosspih doctor`; a line a device, as one JSON array on standard output.
"""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable
from typing import Any

from crosspih_common.config import CellFile, Workcell
from crosspih_common.errors import ConfigError, CrosspihError
from services.hardware.config import DEVICES, HardwareConfig, hardware_of
from services.hardware.drivers.registry import open_devices
from services.hardware.protocols import CameraDevice, JointDevice, Landing, WrenchDevice

CYCLES = 20
SENSOR_S = 1.0  # of waiting for its first sample

Row = dict[str, str]


def _row(name: str, verdict: str, found: str, mend: str = "") -> Row:
    return {"name": name, "verdict": verdict, "found": found, "mend": mend}


def check_devices(cell: CellFile, wanted: frozenset[str] | None, realtime: bool) -> list[Row]:
    """A line for the section `hardware`, and one for each wanted device; those of the cell's file where None."""
    try:
        config = hardware_of(cell)
    except ConfigError as error:
        return [_row("section hardware", "wrong", str(error), "mend the setting that it names")]
    devices = [name for name in DEVICES if name in (config.devices if wanted is None else wanted)]
    rows: list[Row] = []
    try:
        found = open_devices(cell.workcell, config, frozenset(devices), realtime)
    except CrosspihError as error:
        return [_row(f"device {', '.join(devices)}", "wrong", f"not opened: {error}", "mend what it names")]
    except Exception as error:
        # a vendor's library raises what it likes
        said = f"not opened: {type(error).__name__}: {error}"
        return [_row(f"device {', '.join(devices)}", "wrong", said, "is it switched on, and its address right?")]
    looks: dict[str, Callable[[], Row]] = {}
    if "arm" in devices:
        rows.append(_limits(config, found.landing))
    if found.joints is not None:
        joints = found.joints
        looks["arm"] = lambda: _arm(joints, cell.workcell)
    if found.joints is not None and found.wrench is not None:
        looks["force_torque"] = lambda: _sensor(joints, wrench)
        wrench = found.wrench
    if found.camera is not None:
        camera = found.camera
        looks["camera"] = lambda: _camera(camera)
    try:
        for name, look in looks.items():
            rows.append(_looked(name, config.driver_of(name), look))
    finally:
        found.close()
    return rows


def _looked(name: str, driver: str, look: Callable[[], Row]) -> Row:
    try:
        row = look()
    except Exception as error:
        row = _row("", "wrong", f"{type(error).__name__}: {error}", "is it switched on, and its address right?")
    return {**row, "name": f"device {name}", "found": f"{driver}: {row['found']}"}


def _limits(config: HardwareConfig, declared: Landing | None) -> Row:
    """What keeps the forces small."""
    limits = config.limits
    landing, assumed = limits.landing(declared)
    found = (
        f"caps {limits.force_cap_n:g} N and {limits.moment_cap_nm:g} Nm, landing with {landing.moved_mass_kg:g} kg on "
        f"{landing.contact_stiffness_n_m:.3g} N/m"
    )
    if not assumed:
        return _row("force limits", "ok", found)
    named = " and ".join(f"hardware.limits.{name}" for name in assumed)
    return _row(
        "force limits", "warning", f"{found}: taken strictly, so all that may touch goes slowly",
        f"give {named} (docs/safety.md)",
    )  # fmt: skip


def _arm(joints: JointDevice, workcell: Workcell) -> Row:
    readings = [joints.read() for _ in range(CYCLES)]
    last = readings[-1]
    wanted = workcell.arm().joints
    if len(last.positions_rad) != wanted:
        found = f"{len(last.positions_rad)} joints, the cell's arm has {wanted}"
        return _row("", "wrong", found, "name the arm that is there: cell.arm")
    if last.stamp_ns <= readings[0].stamp_ns:
        return _row("", "wrong", f"its stamps stand still over {CYCLES} cycles", "is it switched on and released?")
    outside = workcell.arm().limits.violations(last.positions_rad)
    if outside:
        return _row("", "wrong", "; ".join(outside), "move it inside by its pendant; or cell.arm is another arm")
    period_ms = (last.stamp_ns - readings[0].stamp_ns) * 1e-6 / (CYCLES - 1)
    angles = ", ".join(f"{value:+.3f}" for value in last.positions_rad)
    return _row("", "ok", f"{wanted} joints inside their limits, a cycle of {period_ms:.2f} ms, at ({angles}) rad")


def _sensor(joints: JointDevice, wrench: WrenchDevice) -> Row:
    until = time.monotonic() + SENSOR_S
    count = 0
    last: Any = None
    while count < CYCLES and time.monotonic() < until:
        joints.read()
        samples = wrench.read()
        count += len(samples.stamps_ns)
        last = samples.wrenches[-1] if len(samples.wrenches) else last
    if last is None:
        return _row("", "wrong", f"no sample within {SENSOR_S:g} s", "is it switched on, and its address right?")
    said = ", ".join(f"{value:+.3g}" for value in last)
    return _row("", "ok", f"samples every {wrench.period_s * 1e3:.3g} ms, the last raw one ({said})")


def _camera(camera: CameraDevice) -> Row:
    known = camera.calibration()
    sizes = f"{known.left.width_px} x {known.left.height_px} and {known.right.width_px} x {known.right.height_px}"
    return _row("", "ok", f"two cameras, {sizes} pixels, exposure {camera.exposure_s * 1e3:g} ms")


def print_check(cell: CellFile, wanted: frozenset[str] | None, realtime: bool) -> int:
    """The lines as JSON; status 1 when one is wrong."""
    with contextlib.redirect_stdout(sys.stderr):  # a vendor's library may talk
        rows = check_devices(cell, wanted, realtime)
    print(json.dumps(rows))
    return int(any(row["verdict"] == "wrong" for row in rows))
