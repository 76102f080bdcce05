"""The devices of one process put together: the arm under its controller, the camera, the trials of a simulated cell."""

from __future__ import annotations

from crosspih_common.config import Workcell
from crosspih_common.messages import CameraCalibration, CaptureStereo, ResetCell, SimulationTruth
from services.hardware.config import DEVICES, HardwareConfig
from services.hardware.control.arm import ArmController
from services.hardware.drivers.registry import Tell, open_devices, print_on_standard_error
from services.hardware.protocols import CameraDevice, Devices, Simulation, StereoCapture


class HostedCamera:
    """The cameras. Where time goes by in the arm's cycles alone, they expose while the arm of the process holds still:
    in a simulated cell, and in any whose time stands between commands."""

    def __init__(self, camera: CameraDevice, arm: ArmController | None, on_arms_time: bool) -> None:
        self._camera = camera
        self._arm = arm if on_arms_time else None

    def calibration(self) -> CameraCalibration:
        """What the cameras are and where they stand."""
        return self._camera.calibration()

    def capture(self, command: CaptureStereo) -> StereoCapture:
        """Take a pair as asked."""
        if self._arm is None:
            return self._camera.capture(command.exposure_scale, command.lamp)
        with self._arm.between_motions():
            self._arm.hold_still(self._camera.exposure_s * command.exposure_scale)
            return self._camera.capture(command.exposure_scale, command.lamp)


class HostedSimulation:
    """The trials of a simulated cell: none begins while the arm moves."""

    def __init__(self, simulation: Simulation, arm: ArmController) -> None:
        self._simulation, self._arm = simulation, arm

    def reset(self, command: ResetCell) -> SimulationTruth:
        """A new trial. Raises CommandRefused: busy, not_finite, unreachable, peg_in_contact."""
        with self._arm.exclusively():
            truth = self._simulation.reset(command)
            self._arm.restart()
            return truth

    def truth(self) -> SimulationTruth:
        """What the simulator knows now."""
        return self._simulation.truth()


class HostedCell:
    """What one process hosts; None is what another process does."""

    def __init__(self, devices: Devices, workcell: Workcell, config: HardwareConfig) -> None:
        self._devices = devices
        self.realtime = devices.realtime
        self.assumed: tuple[str, ...] = ()  # settings of `hardware.limits` that nobody gave, taken strictly
        self._controller: ArmController | None = None
        if devices.joints is not None and devices.wrench is not None:
            landing, self.assumed = config.limits.landing(devices.landing)
            self._controller = ArmController(
                workcell, config.limits, landing, devices.joints, devices.wrench, devices.realtime
            )
        self._camera: HostedCamera | None = None
        if devices.camera is not None:
            on_arms_time = devices.simulation is not None or not devices.realtime
            self._camera = HostedCamera(devices.camera, self._controller, on_arms_time)
        self._simulation: HostedSimulation | None = None
        if devices.simulation is not None and self._controller is not None:
            self._simulation = HostedSimulation(devices.simulation, self._controller)

    @property
    def has_arm(self) -> bool:
        """Whether the arm, and with it the sensor, is in this process."""
        return self._controller is not None

    @property
    def has_camera(self) -> bool:
        """Whether the cameras are in this process."""
        return self._camera is not None

    @property
    def has_simulation(self) -> bool:
        """False on a real cell."""
        return self._simulation is not None

    @property
    def arm(self) -> ArmController:
        """The arm. Raises AttributeError where another process has it."""
        if self._controller is None:
            raise AttributeError("this process hosts no arm")
        return self._controller

    @property
    def camera(self) -> HostedCamera:
        """The cameras. Raises AttributeError where another process has them."""
        if self._camera is None:
            raise AttributeError("this process hosts no camera")
        return self._camera

    @property
    def simulation(self) -> HostedSimulation:
        """The trials of a simulated cell. Raises AttributeError on a real one."""
        if self._simulation is None:
            raise AttributeError("this cell is not simulated")
        return self._simulation

    def close(self) -> None:
        """Stop all motion and let go of the devices; a second call does nothing."""
        if self._controller is not None:
            self._controller.close()
        self._devices.close()


def open_cell(
    workcell: Workcell, config: HardwareConfig, realtime: bool, wanted: frozenset[str] = frozenset(DEVICES),
    tell: Tell = print_on_standard_error,
) -> HostedCell:  # fmt: skip
    """Open the wanted devices by the drivers that the configuration names, and put them together."""
    return HostedCell(open_devices(workcell, config, wanted, realtime, tell), workcell, config)
