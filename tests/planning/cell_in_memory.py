"""The real simulated cell and the real services over the in-memory bus; only vision is played, from the truth plus
noise, so that a test decides how good it is."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.config import PegDrawing, load_cell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import ASSEMBLE, CALIBRATE_FT, LOCATE, PHASE, RESET, TRUTH
from crosspih_common.messages import (
    Assemble,
    AssemblyPhase,
    AssemblyResult,
    CalibrateFt,
    HoleEstimate,
    LocateHole,
    PoseData,
    PosePrior,
    ResetCell,
    SimulationTruth,
    Strategy,
    floats,
)
from crosspih_common.service.lifecycle import ServiceContext, ServiceResource
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.shell import ForceTorqueShell
from services.hardware.config import HardwareConfig
from services.hardware.control.config import LimitsConfig
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.hosting import open_cell
from services.hardware.shells.hardware import HardwareShell
from services.inference.config import InferenceConfig
from services.inference.shell.service import InferenceShell
from services.planning.config import PlanningConfig
from services.planning.shell import PlanningShell

# one standard deviation of the played vision: m and rad, in the hole frame
VISION_SD = np.array([5e-5, 5e-5, 1.5e-4, 3e-3, 3e-3, 5e-4])
CALIBRATION = "ft.yaml"


@lru_cache(maxsize=2)
def _calibration(peg: PegDrawing | None) -> bytes:
    """The file of a calibration, made once a process: it takes as long as an assembly."""
    with tempfile.TemporaryDirectory() as folder:
        cell = CellInMemory(Path(folder), with_inference=False, peg=peg, calibrated=False)
        try:
            cell.bus.call(CALIBRATE_FT, CalibrateFt(), 300.0)
        finally:
            cell.close()
        return (Path(folder) / CALIBRATION).read_bytes()


class CellInMemory:
    """A cell; `vision_scale` multiplies the played vision's error, None makes it refuse.

    `vision_lie` (6,), m and rad in the hole frame, is an error on top that vision does not tell. Its force/torque
    sensor is calibrated already, unless `calibrated` is False; a folder's own calibration goes before that.
    """

    def __init__(
        self,
        folder: Path,
        *,
        with_inference: bool = True,
        planning: PlanningConfig | None = None,
        half_range_lateral_m: float | None = None,
        peg: PegDrawing | None = None,
        simulated: SimulatedConfig | None = None,
        limits: LimitsConfig | None = None,
        calibrated: bool = True,
    ) -> None:
        file = folder / CALIBRATION
        if calibrated and not file.exists():
            file.write_bytes(_calibration(peg))
        planning = planning or PlanningConfig(service_patience_s=0.5)
        self.hub = MemoryHub()
        self.cell = load_cell("deploy/cells/default.yaml")
        if half_range_lateral_m is not None:
            prior = self.cell.workcell.hole_prior.model_copy(update={"half_range_lateral_m": half_range_lateral_m})
            self.cell = replace(self.cell, workcell=self.cell.workcell.model_copy(update={"hole_prior": prior}))
        if peg is not None:
            self.cell = replace(self.cell, workcell=self.cell.workcell.model_copy(update={"peg": peg}))
        self.vision_scale: float | None = 1.0
        self.vision_lie: Array = np.zeros(6)
        self.vision_warnings: tuple[str, ...] = ()
        self.contexts: list[ServiceContext] = []
        self.phases: list[AssemblyPhase] = []
        self.on_phase: Callable[[AssemblyPhase], None] = lambda phase: None
        hardware = self.context("hardware")
        settings = HardwareConfig(simulated=simulated or SimulatedConfig(), limits=limits or LimitsConfig())
        self.planning = PlanningShell(self.context("planning"), planning)
        self._shells: list[ServiceResource] = [
            HardwareShell(open_cell(self.cell.workcell, settings, False), hardware),
            ForceTorqueShell(self.context("force_torque"), ForceTorqueConfig(calibration_file=str(file))),
            self.planning,
        ]
        if with_inference:
            self._shells.append(InferenceShell(self.context("inference"), InferenceConfig()))
        self.bus = self.context("operator").bus
        self.context("vision").bus.serve(LOCATE, self._locate)
        self._latest_truth = self.bus.latest(TRUTH)
        # taken on the planner's own thread, so that a test can act between two steps
        self.hub.transport().subscribe(PHASE.key(self.cell.workcell.name), self._take_phase, recover=False)

    def context(self, service: str) -> ServiceContext:
        """A service's place on the bus."""
        bus = Bus(self.hub.transport(), self.cell.workcell.name, service)
        self.contexts.append(ServiceContext(service, self.cell, bus))
        return self.contexts[-1]

    def _take_phase(self, key: str, payload: bytes, label: str, author: str) -> None:
        phase = AssemblyPhase.model_validate_json(payload)
        self.phases.append(phase)
        self.on_phase(phase)

    def _locate(self, request: LocateHole) -> HoleEstimate:
        if self.vision_scale is None:
            raise CommandRefused("no_cross", "left: no dark region has the shape of the hole")
        rng = np.random.default_rng(self.truth().seed)
        sd = VISION_SD * self.vision_scale
        error = rng.normal(size=6) * sd + self.vision_lie
        pose = self.truth().pose_base_hole.pose() @ Pose.from_rotvec(error[3:], error[:3])
        return HoleEstimate(
            pose_base_hole=PoseData.of(pose),
            covariance=floats(np.diag(np.maximum(sd, 1e-6) ** 2)),
            method=request.method,
            orientation_measured=True,
            capture_id=1,
            capture_wall_s=0.0,
            warnings=self.vision_warnings,
        )

    def truth(self) -> SimulationTruth:
        """What the simulator knows now."""
        truth = self._latest_truth.value()
        assert truth is not None
        return truth

    def reset(self, seed: int, **overrides: Any) -> SimulationTruth:
        """A new trial."""
        return self.bus.call(RESET, ResetCell(seed=seed, **overrides), 30.0)

    def assemble(self, strategy: Strategy = Strategy.FUSED, known: PosePrior | None = None) -> AssemblyResult:
        """One assembly."""
        self.phases.clear()
        return self.bus.call(ASSEMBLE, Assemble(assembly_id="test", strategy=strategy, known=known), 300.0)

    def lose(self, service: str) -> None:
        """One service dies, for good."""
        next(context for context in self.contexts if context.name == service).bus.close()

    def close(self) -> None:
        """End everything."""
        for shell in self._shells:
            shell.close()
        for context in self.contexts:
            context.bus.close()
