"""`crosspih bench protocols`: assemblies in a cell that is reached only by its devices' own protocols."""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict
from rich.table import Table

from crosspih_common.config import load_cell
from crosspih_common.config.cell import standing_alone
from crosspih_common.errors import CrosspihError
from crosspih_common.keys import JOINT_STATE
from crosspih_common.messages import JointState, Strategy
from crosspih_common.plain_yaml import yaml_of
from deploy.launcher import LauncherError
from services.operator.assembly.session import NEEDED, Session
from services.operator.bench.cells.conditions import merged
from services.operator.bench.cells.own_cell import CellTask, OwnCell
from services.operator.bench.protocols.plants import Plant, ProtocolWay, open_plant
from services.operator.scoring.score import score
from services.operator.scoring.statistics import sight_row, wilson95

CALIBRATION_DWELL_S = 0.25


class ProtocolTrial(BaseModel):
    """One assembly through the protocols. Cycles are those of the simulated arm; late_states those of our own loop."""

    model_config = ConfigDict(frozen=True)

    seed: int
    inserted: bool
    failure: str | None
    detail: str
    motion_s: float | None = None
    duration_s: float | None = None
    peak_force_n: float | None = None
    looked: bool = False
    vision_refused: str = ""
    felt_for: bool = False
    vision_error_mm: float | None = None
    final_error_mm: float | None = None
    final_error_deg: float | None = None
    wall_s: float = 0.0
    cycles: int = 0
    late_cycles: int = 0
    states: int = 0
    late_states: int = 0
    cycle_ms: tuple[float, float] | None = None  # between joint states: median, 99.9 %


class ProtocolResult(BaseModel):
    """What `crosspih bench protocols --json` prints."""

    model_config = ConfigDict(frozen=True)

    way: str
    inserted: int
    trials: list[ProtocolTrial]


class CycleCount:
    """Counts the joint states of the hardware service, and those whose own stamps are a cycle late or more."""

    def __init__(self) -> None:
        self._stamps_ns: list[int] = []

    def add_state(self, state: JointState) -> None:
        """Count one state."""
        self._stamps_ns.append(state.stamp_ns)

    def counted(self) -> tuple[int, int, tuple[float, float] | None]:
        """States, late ones, and the time between two of them, ms: median and 99.9 %."""
        gaps_ms = np.diff(np.asarray(self._stamps_ns)) * 1e-6
        if not len(gaps_ms):
            return 0, 0, None
        usual = float(np.median(gaps_ms))
        late = int(np.sum(gaps_ms > 1.5 * usual))
        return len(gaps_ms) + 1, late, (usual, float(np.quantile(gaps_ms, 0.999)))


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    plant: Plant
    seed: int
    strategy: Strategy
    began_s: float


@dataclass(frozen=True, slots=True)
class Calibrated:
    """A cell's file with the calibrations found (walking.py), and the seed of the hidden errors of the
    cell behind it.
    """

    content: dict[str, Any]
    hides: int

    def reached_by(self, way: ProtocolWay, plant: Plant) -> dict[str, Any]:
        """The cell's file for a plant: calibrations found through UR's protocols hold for the same cell
        behind others.
        """
        if way is ProtocolWay.UR:
            return self.content
        cameras = (self.content.get("hardware", {}).get("genicam") or {}).get("calibration")
        hardware = merged(plant.content["hardware"], {"ros2": {"camera": {"calibration": cameras}}})
        return {**self.content, "hardware": hardware}


def calibrated_cell(file: Path, hides: int) -> Calibrated:
    """Read from a cell's file, with absolute paths for the files that it names. Raises ConfigError."""
    content = standing_alone(file, yaml_of(load_cell(file).text) or {})
    cameras = (content.get("hardware", {}).get("genicam") or {}).get("calibration")
    if cameras is not None:
        beside = Path(cameras) if Path(cameras).exists() else file.resolve().parent / cameras
        content = merged(content, {"hardware": {"genicam": {"calibration": str(beside.resolve())}}})
    return Calibrated(content, hides)


def assembled(way: ProtocolWay, seed: int, strategy: Strategy, calibrated: Calibrated | None = None) -> ProtocolTrial:
    """One assembly in a separate cell: everything is started for it and ended after it."""
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="crosspih-protocols-") as folder:
        try:
            with open_plant(way, seed, Path(folder), None if calibrated is None else calibrated.hides) as plant:
                asked = _Asked(plant, seed, strategy, began_s)
                content = plant.content if calibrated is None else calibrated.reached_by(way, plant)
                task = CellTask(f"seed {seed}", content, _trial, asked, NEEDED, calibrate=False, speed="realtime")
                cell = OwnCell(0, task)
                try:
                    return _trial(cell.start(), asked)
                except (CrosspihError, LauncherError) as error:
                    raise CrosspihError(f"{error}; {cell.last_words()}") from None
                finally:
                    cell.close()
        except (CrosspihError, LauncherError) as error:
            return ProtocolTrial(
                seed=seed, inserted=False, failure="no_result", detail=f"{type(error).__name__}: {error}",
                wall_s=time.monotonic() - began_s,
            )  # fmt: skip


def _trial(session: Session, asked: _Asked) -> ProtocolTrial:
    session.calibrate_ft(CALIBRATION_DWELL_S)
    count = CycleCount()
    session.bus.subscribe(JOINT_STATE, count.add_state)
    _, result = session.trial(None, asked.strategy, False)
    states, late_states, cycle_ms = count.counted()
    cycles, late_cycles = asked.plant.cycles()
    figures = score(
        session.cell.workcell, result, asked.plant.truth(), wall_s=time.monotonic() - asked.began_s, recording=None
    )
    return ProtocolTrial(
        seed=asked.seed, inserted=figures.inserted, failure=figures.failure, detail=figures.failure_detail,
        motion_s=figures.motion_s, duration_s=figures.duration_s, peak_force_n=figures.peak_force_n,
        looked=figures.looked, vision_refused=figures.vision_refused, felt_for=figures.felt_for,
        vision_error_mm=figures.vision_error_mm, final_error_mm=figures.final_error_mm,
        final_error_deg=figures.final_error_deg, wall_s=figures.wall_s, cycles=cycles, late_cycles=late_cycles,
        states=states, late_states=late_states, cycle_ms=cycle_ms,
    )  # fmt: skip


def line_of(trial: ProtocolTrial) -> str:
    """One line per assembly, printed as each ends."""
    said = [f"seed {trial.seed}: {'inserted' if trial.inserted else trial.failure}"]
    if trial.motion_s is not None:
        said.append(f"motion {trial.motion_s:.1f} s")
    if trial.peak_force_n is not None:
        said.append(f"peak {trial.peak_force_n:.1f} N")
    if trial.cycles:
        said.append(f"{trial.late_cycles} of {trial.cycles} cycles late")
    if trial.states:
        said.append(f"{trial.late_states} of {trial.states} joint states late")
    said.append(f"{trial.wall_s:.0f} s in all")
    return ", ".join(said) + (f": {trial.detail}" if trial.detail else "")


def table_of(result: ProtocolResult) -> Table:
    """Counts, times and errors."""
    count = len(result.trials)
    low, high = wilson95(result.inserted, count)
    table = Table(title=f"{count} assemblies, every device by its protocol ({result.way}), in real time")
    table.add_column("")
    table.add_column("p50 / p95", justify="right")
    table.add_row("inserted", f"{result.inserted} of {count} ({low:.1%} to {high:.1%})")
    table.add_row(*sight_row(result.trials))
    for label, name, digits in (
        ("motion, s", "motion_s", 1), ("motion and thinking, s", "duration_s", 1), ("peak force, N", "peak_force_n", 1),
        ("vision, across the axis, mm", "vision_error_mm", 3), ("T2, across the axis, mm", "final_error_mm", 3),
        ("T2, rotation, °", "final_error_deg", 3),
    ):  # fmt: skip
        values = [value for one in result.trials if one.inserted and (value := getattr(one, name)) is not None]
        if values:
            table.add_row(label, f"{median(values):.{digits}f} / {np.quantile(values, 0.95):.{digits}f}")
    cycles, late = sum(one.cycles for one in result.trials), sum(one.late_cycles for one in result.trials)
    table.add_row("cycles of the arm's other end, late ones", f"{cycles}, {late}")
    states, late = sum(one.states for one in result.trials), sum(one.late_states for one in result.trials)
    table.add_row("joint states during the assemblies, late ones", f"{states}, {late}")
    between = [one.cycle_ms for one in result.trials if one.cycle_ms is not None]
    if between:
        table.add_row(
            "between two joint states, ms, median and 99.9 %",
            f"{median(one[0] for one in between):.2f}, {max(one[1] for one in between):.2f}",
        )
    for failure, times in Counter(one.failure for one in result.trials if not one.inserted).items():
        table.add_row(f"ended as {failure}", str(times))
    return table
