"""The settings of the cell's file that follow from a calibration by pushes. A simulated cell stays the same machine:
each difference to the drawing in `hardware.simulated` is rewritten relative to the new drawing.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crosspih_common.calibration.mount import MountFit
from crosspih_common.calibration.stiffness import StiffnessFit
from crosspih_common.calibration.tcp import TipFit
from crosspih_common.config import CellFile
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array


def _simulated(cell: CellFile) -> dict[str, Any] | None:
    hardware = cell.sections.get("hardware", {})
    if hardware.get("driver", "simulated") != "simulated":
        return None
    return dict(hardware.get("simulated") or {})


def _floats(values: Array) -> list[float]:
    return [round(float(value), 9) for value in values]


def stiffness_settings(fit: StiffnessFit, cell: CellFile) -> dict[str, Any]:
    """`cell.joint_stiffness_nm_rad`, with the values that the pushes determine; nothing where they determine none."""
    before = np.asarray(cell.workcell.joint_stiffness_nm_rad, float)
    if not any(fit.taken):
        return {}
    after = np.where(fit.taken, fit.stiffness_nm_rad, before)
    settings: dict[str, Any] = {"cell": {"joint_stiffness_nm_rad": [round(float(value), 1) for value in after]}}
    simulated = _simulated(cell)
    if simulated is not None:
        truth = simulated.get("truth") or {}
        factors = np.asarray(truth.get("joint_stiffness_factors") or np.ones(len(before)), float)
        kept = factors * before / np.asarray(settings["cell"]["joint_stiffness_nm_rad"])
        settings["hardware"] = {"simulated": {"truth": {"joint_stiffness_factors": _floats(kept)}}}
    return settings


def mount_settings(fit: MountFit, cell: CellFile) -> dict[str, Any]:
    """`cell.force_torque.correction`: the whole correction, relative to the mounting that is drawn."""
    drawn = cell.workcell.force_torque.as_drawn().mounting(cell.workcell.pose_flange_peg()).pose_peg_sensor
    correction = fit.pose_peg_sensor @ drawn.inverse()
    placed = {"shift_m": _floats(correction.translation_m), "turn_rad": _floats(correction.rotvec_rad())}
    return {"cell": {"force_torque": {"correction": placed}}}


def tcp_settings(fit: TipFit, cell: CellFile) -> dict[str, Any]:
    """`cell.flange_to_ft`, the peg's frame on the flange; the sensor keeps its place on the flange."""
    workcell, shift = cell.workcell, Pose.from_translation(fit.shift_m)
    before = workcell.pose_flange_peg()
    peg = before @ shift
    section = workcell.force_torque
    sensor = before if section.pose_flange_sensor is None else section.pose_flange_sensor.pose()
    correction = shift.inverse() @ section.correction.pose() @ shift
    settings: dict[str, Any] = {
        "cell": {
            "flange_to_ft": {"position_m": _floats(peg.translation_m), "rotvec_rad": _floats(peg.rotvec_rad())},
            "force_torque": {
                "pose_flange_sensor": {
                    "position_m": _floats(sensor.translation_m), "rotvec_rad": _floats(sensor.rotvec_rad()),
                },
                "correction": {
                    "shift_m": _floats(correction.translation_m), "turn_rad": _floats(correction.rotvec_rad()),
                },
            },
        }
    }  # fmt: skip
    simulated = _simulated(cell)
    if simulated is not None:
        from_file = (simulated.get("truth") or {}).get("peg_shift_m") or (0.0, 0.0, 0.0)
        hung = (simulated.get("force_torque") or {}).get("payload_centroid_m")
        kept: dict[str, Any] = {"truth": {"peg_shift_m": _floats(np.asarray(from_file) - fit.shift_m)}}
        if hung is not None:
            kept["force_torque"] = {"payload_centroid_m": _floats(np.asarray(hung) - fit.shift_m)}
        settings["hardware"] = {"simulated": kept}
    return settings
