"""Everything that one process hosts, on the bus."""

from __future__ import annotations

from crosspih_common.keys import CLOCK
from crosspih_common.messages import Severity
from crosspih_common.service import ServiceContext
from services.hardware.control.config import STRICT_LANDING
from services.hardware.hosting import HostedCell
from services.hardware.shells.arm import ARM_LANE, ArmShell
from services.hardware.shells.camera import CameraShell
from services.hardware.shells.cell_time import CellTime
from services.hardware.shells.simulation import SimulationShell


class HardwareShell:
    """Binds each device that is there; knows controllers and protocols only, never a driver."""

    def __init__(self, cell: HostedCell, context: ServiceContext) -> None:
        self._cell = cell
        self._arm: ArmShell | None = None
        bus = context.bus
        if cell.has_arm:
            arm = self._arm = ArmShell(cell.arm, bus, cell.realtime, cell.has_simulation)
            cell.arm.on_broken = context.fail
            if cell.arm.broken:  # before anybody listened
                context.fail(cell.arm.broken)
            if cell.has_simulation:
                SimulationShell(cell.simulation, cell.arm, arm, bus)
            for name in cell.assumed:
                context.event(
                    Severity.WARNING,
                    "strict_default",
                    f"hardware.limits.{name}: not given; {getattr(STRICT_LANDING, name):g} is assumed, which makes "
                    "whatever may touch slow; measure it (docs/safety.md) and set it in the cell's file",
                )
        if cell.has_camera:
            # a simulated cell in the same process exposes on the arm's clock, between motions
            CameraShell(cell.camera, bus, ARM_LANE if cell.has_arm else "camera", self._cell_time(context))

    def _cell_time(self, context: ServiceContext) -> CellTime:
        """The cell's time for cameras that have the host's alone: from the arm beside, or as it comes over the bus."""
        bus, cell_time = context.bus, CellTime()
        if self._arm is not None:
            realtime = self._cell.realtime
            self._arm.also_on_tick(lambda: cell_time.tick(bus.clock.now_ns(), "", realtime))
        else:
            bus.subscribe_inline(CLOCK, lambda tick: cell_time.tick(tick.stamp_ns, tick.boot_id, tick.realtime))
        return cell_time

    def close(self) -> None:
        """Stop all motion and let go of the devices."""
        if self._arm is not None:
            self._arm.close()
        self._cell.close()
