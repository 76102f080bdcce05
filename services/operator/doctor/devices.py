"""The devices: asked over the bus where the hardware service runs, else opened by its drivers in a separate process."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from crosspih_common.bus import Bus
from crosspih_common.config import CellFile
from crosspih_common.keys import CAMERA_CALIBRATION, CLOCK, JOINT_STATE, WRENCH_RAW
from crosspih_common.messages import CameraCalibration
from services.operator.cli.rows import Row, ok, warning, wrong
from services.operator.other_services.beside import run_module

HEAR_S = 2.0
OPEN_S = 60.0
DEVICES = ("arm", "force_torque", "camera")


def hosted(cell: CellFile) -> tuple[str, ...]:
    """The devices in `hardware.devices`; all devices where it is not set."""
    named = cell.sections["hardware"].get("devices", DEVICES)
    return tuple(name for name in DEVICES if name in named)


def drivers_of(cell: CellFile) -> set[str]:
    """The drivers that the cell's file names."""
    section = cell.sections.get("hardware", {})
    chosen = section.get("drivers") or {}
    default = section.get("driver", "simulated")
    return {str(chosen.get(device) or default) for device in hosted(cell)} if isinstance(chosen, dict) else {default}


def running_rows(bus: Bus, devices: tuple[str, ...]) -> Iterator[Row]:
    """The rows from a running hardware service."""
    mend = "crosspih logs hardware; crosspih cell check looks closer"
    with bus.reading(CLOCK) as clock:
        tick = clock.wait_for(lambda _: True, HEAR_S)
    stands = tick is not None and not tick.realtime
    with bus.reading(JOINT_STATE) as joints, bus.reading(WRENCH_RAW) as wrench:
        for name, stream in (("arm", joints), ("force_torque", wrench)):
            if name not in devices:
                continue
            heard = stream.wait_for(lambda _: True, HEAR_S)
            if heard is not None:
                yield ok(f"device {name}", "its hardware service runs, and its samples are heard")
            elif stands:
                yield ok(f"device {name}", "its hardware service runs; time stands between its commands (max)")
            else:
                yield wrong(f"device {name}", f"its hardware service runs, no sample within {HEAR_S:g} s", mend)
    if "camera" in devices:
        found = calibration_of(bus)
        if found is None:
            yield wrong("device camera", "no calibration is told: is its process up?", mend)
        else:
            yield ok("device camera", f"told its calibration, {found.left.width_px} x {found.left.height_px} pixels")


def calibration_of(bus: Bus) -> CameraCalibration | None:
    """The calibration that the running cameras publish."""
    with bus.reading(CAMERA_CALIBRATION) as told:
        return told.wait_for(lambda _: True, HEAR_S)


def not_opened_row(alive: set[str]) -> Row:
    """Where services of the cell run but its hardware service does not: a process may hold the devices all the same."""
    return warning(
        "devices", f"not opened: {', '.join(sorted(alive))} live, and a hardware service that hangs would hold them",
        "crosspih logs hardware says what keeps it; or crosspih down, then crosspih doctor",
    )  # fmt: skip


def opened_rows(path: Path) -> Iterator[Row]:
    """The rows of `python -m services.hardware --check`: it opens the devices, reads them, and moves nothing."""
    said = run_module("services.hardware", "--check", "--cell", str(path), deadline_s=OPEN_S)
    if not isinstance(said.value, list):
        yield wrong("devices", said.words or "nothing was said", "mend what it names; is crosspih[hardware] installed?")
        return
    for row in said.value:
        yield Row.model_validate(row)
