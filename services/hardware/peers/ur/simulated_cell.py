"""The simulated cell behind the controller: its arm is moved by the set-points, its sensor is the wrist's."""

from __future__ import annotations

import numpy as np

from crosspih_common.config import CellFile
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import ResetCell, SimulationTruth
from services.hardware.config import HardwareConfig
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.simulated.cell import open_devices
from services.hardware.peers.ur.sources import SensedState


class CellJoints:
    """The simulated cell of a cell's file: its motor side goes where the controller says, its sensor is the wrist's.

    The cell's file draws the sensor as the driver says it: `cell.force_torque` with the flange as its frame.
    """

    def __init__(self, cell: CellFile, period_s: float, watch_contact: bool = False) -> None:
        config = cell.section("hardware", HardwareConfig)
        watch = {"watch_contact": watch_contact or config.simulated.watch_contact}
        simulated = config.simulated.model_copy(update={"period_s": period_s, **watch})
        config = config.model_copy(update={"simulated": simulated})
        request = OpenRequest(cell.workcell, config, frozenset({"arm", "force_torque"}), realtime=False)
        self._devices = open_devices(request)
        assert self._devices.joints is not None and self._devices.wrench is not None
        self._joints, self._wrench = self._devices.joints, self._devices.wrench
        self.model = self._joints.model
        self._raw = np.zeros(6)
        self._seed = simulated.seed

    def restart(self, seed: int | None) -> SensedState:
        """A new trial of the seed; None: of the cell's file."""
        seed = self._seed if seed is None else seed
        assert self._devices.simulation is not None
        self._devices.simulation.reset(ResetCell(seed=seed))
        reading = self._joints.read()
        return SensedState(reading.positions_rad, reading.speeds_rad_s, self._raw)

    def advance(self, joints_rad: Array, speeds_rad_s: Array) -> SensedState:
        """A cycle of physics; the sensor's samples of it are averaged."""
        self._joints.write(joints_rad, speeds_rad_s)
        reading = self._joints.read()
        samples = self._wrench.read()
        if len(samples.wrenches):
            self._raw = samples.wrenches.mean(axis=0)
        return SensedState(reading.positions_rad, reading.speeds_rad_s, self._raw)

    def truth(self) -> SimulationTruth | None:
        """What the simulator knows now."""
        assert self._devices.simulation is not None
        return self._devices.simulation.truth()

    def close(self) -> None:
        """Let go of the engine."""
        self._devices.close()
