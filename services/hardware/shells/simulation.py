"""Binds a simulated cell's trials and truth to their keys."""

from __future__ import annotations

from crosspih_common.bus import Bus
from crosspih_common.keys import RESET, TRUTH
from crosspih_common.messages import ResetCell, SimulationTruth
from services.hardware.control.arm import ArmController
from services.hardware.hosting import HostedSimulation
from services.hardware.shells.arm import ARM_LANE, ArmShell


class SimulationShell:
    """Tells the truth with each tick of the clock, for scoring; serves resets."""

    def __init__(self, simulation: HostedSimulation, arm: ArmController, arm_shell: ArmShell, bus: Bus) -> None:
        self._simulation, self._arm, self._arm_shell = simulation, arm, arm_shell
        self._truth = bus.publisher(TRUTH)
        self._tell()
        arm_shell.also_on_tick(self._tell)
        bus.serve(RESET, self._reset, lane=ARM_LANE)

    def _tell(self) -> None:
        self._truth.publish(self._simulation.truth())

    def _reset(self, command: ResetCell) -> SimulationTruth:
        truth = self._simulation.reset(command)
        self._arm_shell.tick(self._arm.now_ns())
        return truth
