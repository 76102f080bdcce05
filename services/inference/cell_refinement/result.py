"""From a cell and its past recordings to refined values, as plain data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from crosspih_common.config import CellFile
from services.inference.cell_refinement.assemblies import RecordedAssemblies, camera_correction
from services.inference.cell_refinement.joint import JointFit, joint_fit
from services.inference.cell_refinement.parameters import (
    CAMERA,
    GEOMETRY,
    NAMES,
    PRIOR_SD,
    TURN,
    Refined,
    judged,
    refined_peg,
)
from services.inference.cell_refinement.weighing import sensor_turn

Teller = Callable[[str, int, int], None]
WANTED = {
    "taper": "assemblies with two or more touches each (a strategy that touches, or vision switched off)",
    "clearance": "assemblies that ended seated, with their presses against the bore",
    "ft": "assemblies with touches; for the turns a calibration of the sensor (`crosspih calibrate ft`) recorded",
    "camera": "assemblies that vision began; for the depth also with touches",
}


@dataclass(frozen=True, slots=True, eq=False)
class Refinement:
    """Every parameter with its outcome, the fits behind it, and the reasons for parameters that were not taken."""

    parameters: tuple[Refined, ...]
    joint: JointFit
    assemblies: int
    touches: int
    presses: int
    seen: int
    calibrations: int
    notes: tuple[str, ...]

    def as_data(self, cell: CellFile) -> dict[str, object]:
        """For JSON: the table, the residuals, and `settings`, the new values for the cell's file."""
        return {
            "parameters": [{**asdict(one), "value": one.value} for one in self.parameters],
            "friction": self.joint.friction,
            "friction_sd": self.joint.friction_sd,
            "contact_rms": list(self.joint.contact_rms),
            "vision_rms": list(self.joint.vision_rms) if self.seen else None,
            "assemblies": self.assemblies,
            "touches": self.touches,
            "presses": self.presses,
            "seen": self.seen,
            "calibrations": self.calibrations,
            "notes": list(self.notes),
            "settings": self.settings(cell),
        }

    def settings(self, cell: CellFile) -> dict[str, object]:
        """The sections of the cell's file with the values taken; empty if none was."""
        by_name = {one.name: one for one in self.parameters}

        def any_taken(names: tuple[str, ...]) -> bool:
            return any(by_name[name].taken for name in names if name in by_name)

        def values(names: tuple[str, ...]) -> list[float]:
            return [by_name[name].value for name in names]

        settings: dict[str, dict[str, object]] = {}
        if by_name["taper"].taken:
            settings.setdefault("cell", {})["peg"] = refined_peg(cell.workcell.peg, by_name["taper"].value)
        if by_name["clearance"].taken:
            value = cell.workcell.hole.clearance_m + by_name["clearance"].value
            settings.setdefault("cell", {})["hole"] = {"clearance_m": value}
        if any_taken(GEOMETRY[2:]):
            correction = {"shift_m": values(GEOMETRY[2:5]), "turn_rad": values(GEOMETRY[5:])}
            settings.setdefault("cell", {})["force_torque"] = {"correction": correction}
        if any_taken(CAMERA):
            settings["vision"] = {"camera_correction": {"shift_m": values(CAMERA[:3]), "turn_rad": values(CAMERA[3:])}}
        return dict(settings)


def refine(cell: CellFile, past: RecordedAssemblies, tell: Teller = lambda doing, done, total: None) -> Refinement:
    """Fit all data of the cell's past recordings."""
    sensor = cell.workcell.force_torque.correction.pose()
    camera = camera_correction(cell.sections)
    before = np.concatenate(
        [[0.0, 0.0], sensor.translation_m, sensor.rotvec_rad(), camera.translation_m, camera.rotvec_rad()]
    )
    turn = sensor_turn(past.weighings, PRIOR_SD[TURN])
    joint = joint_fit(cell.workcell, past.assemblies, before, turn, tell)
    parameters = judged(NAMES, before, joint.parameters, joint.covariance, PRIOR_SD)
    seen = sum(one.seen is not None for one in past.assemblies)
    notes = list(past.left_out)
    for group, wanted in WANTED.items():
        held = [one.name for one in parameters if one.name.startswith(group) and not one.taken]
        if held:
            notes.append(f"{', '.join(held)}: kept as they were, the recordings do not fix them; wanted: {wanted}")
    return Refinement(
        tuple(parameters),
        joint,
        len(past.assemblies),
        sum(len(one.touches) for one in past.assemblies),
        sum(len(one.presses) for one in past.assemblies),
        seen,
        len(past.weighings),
        tuple(notes),
    )
