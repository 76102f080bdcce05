"""The simulated cell of a cell's file over the in-memory bus, as a session of the operator sees it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import yaml

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.config import load_cell
from crosspih_common.keys import CALIBRATE_FT
from crosspih_common.messages import CalibrateFt, FtCalibration
from crosspih_common.service.lifecycle import ServiceContext, ServiceResource
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.shell import ForceTorqueShell
from services.hardware.config import HardwareConfig
from services.hardware.hosting import open_cell
from services.hardware.shells.hardware import HardwareShell
from services.operator.assembly.session import Session
from services.planning.config import PlanningConfig
from services.planning.shell import PlanningShell
from services.recorder.config import RecorderConfig
from services.recorder.shell import RecorderShell


class CalibratedCell:
    """Hardware, what calibrates the force/torque sensor, and the recorder; `content` is the cell's file."""

    def __init__(self, folder: Path, content: dict[str, Any]) -> None:
        path = folder / "cell.yaml"
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        self.hub = MemoryHub()
        self.cell = load_cell(path)
        self.contexts: list[ServiceContext] = []
        config = self.cell.section("hardware", HardwareConfig)
        self._shells: list[ServiceResource] = [
            HardwareShell(open_cell(self.cell.workcell, config, False), self._context("hardware"))
        ]
        file = str(folder / "ft.yaml")
        self._shells += [
            ForceTorqueShell(self._context("force_torque"), ForceTorqueConfig(calibration_file=file)),
            PlanningShell(self._context("planning"), PlanningConfig(service_patience_s=0.5)),
            RecorderShell(self._context("recorder"), RecorderConfig(directory=folder / "recordings")),
        ]
        self.bus = self._context("operator").bus

    def _context(self, service: str) -> ServiceContext:
        bus = Bus(self.hub.transport(), self.cell.workcell.name, service)
        self.contexts.append(ServiceContext(service, self.cell, bus))
        return self.contexts[-1]

    def calibrate_ft(self, samples_s: float) -> FtCalibration:
        """As a session does."""
        return self.bus.call(CALIBRATE_FT, CalibrateFt(samples_s=samples_s), 300.0)

    def session(self) -> Session:
        """What a calibration asks of a session: `bus`, `cell` and `calibrate_ft`."""
        return cast(Session, self)

    def close(self) -> None:
        """End everything."""
        for shell in self._shells:
            shell.close()
        for context in self.contexts:
            context.bus.close()
