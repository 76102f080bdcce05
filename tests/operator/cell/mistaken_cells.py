"""Cells with one mistake each, as their authors make them: thin drivers around the simulated devices, and arms that
serve their keys wrongly. Everything else is the real hardware service on a bus in memory."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.config import CellFile, load_cell
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Dwell, JointState
from crosspih_common.service.lifecycle import ServiceContext
from services.hardware.config import HardwareConfig
from services.hardware.control.arm import ArmController
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.simulated.cell import open_devices as open_simulated
from services.hardware.hosting import open_cell
from services.hardware.protocols import (
    CameraDevice,
    Devices,
    JointDevice,
    JointReading,
    StereoCapture,
    WrenchDevice,
    WrenchSamples,
)
from services.hardware.shells.hardware import HardwareShell

UNIX_NS = 1_790_000_000 * 10**9
HERE = "tests.operator.cell.mistaken_cells"


class _Degrees:
    """Gives degrees, and takes them."""

    def __init__(self, joints: JointDevice) -> None:
        self._joints, self.model, self.period_s = joints, joints.model, joints.period_s

    def read(self) -> JointReading:
        reading = self._joints.read()
        return JointReading(reading.stamp_ns, np.rad2deg(reading.positions_rad), np.rad2deg(reading.speeds_rad_s))

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        self._joints.write(np.deg2rad(positions_rad), np.deg2rad(speeds_rad_s))

    def halt(self) -> None:
        self._joints.halt()


class _WallStamps:
    """A sensor that stamps by the wall's clock."""

    def __init__(self, wrench: WrenchDevice) -> None:
        self._wrench, self.period_s = wrench, wrench.period_s

    def read(self) -> WrenchSamples:
        samples = self._wrench.read()
        return WrenchSamples(samples.stamps_ns + UNIX_NS, samples.wrenches)


class _OtherPeriod(_WallStamps):
    """A sensor that says 500 Hz of its 1000."""

    def __init__(self, wrench: WrenchDevice) -> None:
        super().__init__(wrench)
        self.period_s = 2.0 * wrench.period_s

    def read(self) -> WrenchSamples:
        return self._wrench.read()


class _HalfSize:
    """Cameras that send every other pixel, under a calibration of the whole picture."""

    def __init__(self, camera: CameraDevice) -> None:
        self._camera, self.exposure_s, self.calibration = camera, camera.exposure_s, camera.calibration

    def capture(self, exposure_scale: float, lamp: int) -> StereoCapture:
        taken = self._camera.capture(exposure_scale, lamp)
        return dataclasses.replace(taken, left=taken.left[::2, ::2], right=taken.right.T.copy())


def _bare(request: OpenRequest) -> Devices:
    return dataclasses.replace(open_simulated(request), simulation=None)


def sound(request: OpenRequest) -> Devices:
    """Nothing is wrong."""
    return _bare(request)


def in_degrees(request: OpenRequest) -> Devices:
    """Joints in degrees."""
    devices = _bare(request)
    assert devices.joints is not None
    return dataclasses.replace(devices, joints=_Degrees(devices.joints))


def wall_stamps(request: OpenRequest) -> Devices:
    """The sensor on another clock."""
    devices = _bare(request)
    assert devices.wrench is not None
    return dataclasses.replace(devices, wrench=_WallStamps(devices.wrench))


def other_period(request: OpenRequest) -> Devices:
    """The sensor's period is not what it says."""
    devices = _bare(request)
    assert devices.wrench is not None
    return dataclasses.replace(devices, wrench=_OtherPeriod(devices.wrench))


def half_size(request: OpenRequest) -> Devices:
    """Pictures of another size than the calibration says."""
    devices = _bare(request)
    assert devices.camera is not None
    return dataclasses.replace(devices, camera=_HalfSize(devices.camera))


# what an arm that serves the keys itself may do wrongly ------------------------------------------------------------


def speeds_in_degrees(arm: ArmController) -> None:
    """Told joint speeds are in degrees a second."""
    _tell_speeds(arm, 180.0 / np.pi)


def speeds_left_out(arm: ArmController) -> None:
    """Told joint speeds are zero."""
    _tell_speeds(arm, 0.0)


def _tell_speeds(arm: ArmController, factor: float) -> None:
    listen = arm.on_joint_state

    def on_joint_state(listener: Callable[[JointState], object]) -> None:
        listen(
            lambda state: listener(
                state.model_copy(update={"speeds_rad_s": tuple(factor * speed for speed in state.speeds_rad_s)})
            )
        )

    _put(arm, on_joint_state=on_joint_state)


def deaf(arm: ArmController) -> None:
    """A stop is accepted, and nothing stops."""
    _put(arm, stop=lambda: True)


def obliging(arm: ArmController) -> None:
    """No trajectory is refused."""
    _put(arm, follow=lambda command: arm.dwell(Dwell(duration_s=0.01)))


def gullible(arm: ArmController) -> None:
    """Any payload is believed."""
    _put(arm, set_payload=lambda command: None)


def _put(arm: ArmController, **methods: Any) -> None:
    for name, method in methods.items():
        setattr(arm, name, method)


@contextmanager
def cell_with(
    folder: Path,
    driver: str = "sound",
    *,
    truth: dict[str, Any] | None = None,
    cell: dict[str, Any] | None = None,
    arm: Callable[[ArmController], None] = lambda arm: None,
    tokens: bool = True,
) -> Iterator[tuple[Bus, CellFile]]:
    """The operator's bus of a cell that runs, and the cell's file."""
    file = folder / "cell.yaml"
    hardware = {"driver": f"{HERE}:{driver}", "simulated": {"truth": truth or {}}}
    file.write_text(yaml.safe_dump({"cell": {"name": "mistaken", **(cell or {})}, "hardware": hardware}))
    loaded, hub = load_cell(file), MemoryHub()
    with Bus(hub.transport(), "mistaken", "hardware") as bus:
        hosted = open_cell(loaded.workcell, loaded.section("hardware", HardwareConfig), False)
        arm(hosted.arm)
        if not tokens:
            bus.declare_alive = lambda name=None: None  # type: ignore[method-assign]
        shell = HardwareShell(hosted, ServiceContext("hardware", loaded, bus))
        bus.declare_alive()
        try:
            with Bus(hub.transport(), "mistaken", "operator") as operator:
                yield operator, loaded
        finally:
            shell.close()
