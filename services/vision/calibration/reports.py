"""Calibration results as plain data, with intervals, residuals in px, mm and degrees, and doubts about them."""

from __future__ import annotations

from typing import Any

import numpy as np

from crosspih_common.config.board import BoardPattern
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, Gamma, PoseData
from services.vision.calibration.hand_eye import HandEyeFit
from services.vision.calibration.stereo import StereoFit

ALIKE_SHARE, MIDDLE_SHARE = 0.05, 0.15
BASELINE_M = (0.002, 3.0)
FAR_M, FAR_RAD = 0.1, np.deg2rad(15.0)
GOOD_PX = 0.3


def _values(names: list[str], values: Array, sd: Array, half: Array) -> list[dict[str, Any]]:
    return [
        {"name": name, "value": float(value), "sd": float(one), "half_95": float(wide)}
        for name, value, one, wide in zip(names, values, sd, half, strict=True)
    ]


def stereo_report(
    found: StereoFit, pattern: BoardPattern, parts: list[list[list[int]]], missing: list[str], gamma: Gamma
) -> dict[str, Any]:
    """For JSON; `calibration` is the camera message without `pose_base_camera`, lengths in m, angles in rad."""
    fit, rig, rows = found.fit, found.rig, found.rows
    off = fit.residual.reshape(-1, 2)
    focal = np.array([fit.shared[0], fit.shared[rig.width]])
    away = np.linalg.norm(rows.in_left_m(fit.own), axis=1)
    in_mm = 1e3 * np.linalg.norm(off, axis=1) * away / focal[rows.side]
    left, right = (
        rig.model(fit.shared[side * rig.width : (side + 1) * rig.width], side).model_copy(update={"gamma": gamma})
        for side in (0, 1)
    )
    return {
        "calibration": {
            "left": left.model_dump(mode="json"),
            "right": right.model_dump(mode="json"),
            "pose_left_right": PoseData.of(rig.right(fit.shared)).model_dump(mode="json"),
        },
        "values": _values(rig.names(), fit.shared, fit.sd, fit.half_width()),
        "covariance": fit.covariance.tolist(),
        "model": found.model,
        "held_out_px": found.held_out_px,
        "held_out_mm": float(found.held_out_px[found.model] * 1e3 * np.mean(away) / np.mean(focal)),
        "rms_px": float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
        "rms_mm": float(np.sqrt(np.mean(in_mm**2))),
        "pairs": len(fit.own),
        "corners": len(rows.pair),
        "wild": found.wild,
        "worst_pair": int(np.argmax(fit.rms_of())),
        "parts": parts,
        "missing": missing,
        "doubts": _stereo_doubts(found),
    }


def _stereo_doubts(found: StereoFit) -> list[str]:
    rig, shared, said = found.rig, found.fit.shared, []
    for side, name in enumerate(("left", "right")):
        fx, fy, cx, cy = shared[side * rig.width : side * rig.width + 4]
        width, height = rig.sizes[side]
        if abs(fx / fy - 1.0) > ALIKE_SHARE:
            said.append(f"{name}: fx and fy differ by {abs(fx / fy - 1.0):.0%}; do all pictures have square pixels?")
        if max(abs(cx / width - 0.5), abs(cy / height - 0.5)) > MIDDLE_SHARE:
            said.append(f"{name}: the axis meets the picture at ({cx:.0f}, {cy:.0f}), far from its middle: cropped?")
    baseline = float(np.linalg.norm(rig.right(shared).translation_m))
    if not BASELINE_M[0] < baseline < BASELINE_M[1]:
        said.append(f"the cameras would stand {baseline * 1e3:.1f} mm apart; is the square of --board in metres?")
    if found.held_out_px[found.model] > GOOD_PX:
        said.append(
            f"pictures that were left out are {found.held_out_px[found.model]:.2f} px off; {GOOD_PX:g} and less is "
            "usual: is the board flat, the print in true size, and are the pictures sharp?"
        )
    return said


def hand_eye_report(found: HandEyeFit, told: CameraCalibration, missing: list[str]) -> dict[str, Any]:
    """For JSON; the intervals are of a small change of the camera in its own frame: rad, then m."""
    before = told.pose_base_camera.pose()
    correction = before.inverse() @ found.pose_base_camera
    names = ["rx", "ry", "rz", "x", "y", "z"]
    sd, half = found.fit.sd, found.fit.half_width()
    off = np.sqrt(np.mean(np.sum(found.fit.residual.reshape(-1, 2) ** 2, axis=1)))
    doubts = []
    shift, turn = float(np.linalg.norm(correction.translation_m)), float(np.linalg.norm(correction.rotvec_rad()))
    if shift > FAR_M or turn > FAR_RAD:
        doubts.append(
            f"the camera would stand {shift * 1e3:.0f} mm and {np.rad2deg(turn):.1f} degrees from where the cell's "
            "file has it: is that the board of --board, and are the poses those of this arm's flange?"
        )
    if off > 3.0 * GOOD_PX:
        doubts.append(
            f"{off:.2f} px are left over: the arm's own accuracy, a board that moves on the flange, or cameras that "
            "are not as calibrated (`crosspih calibrate stereo`)"
        )
    return {
        "pose_base_camera": PoseData.of(found.pose_base_camera).model_dump(mode="json"),
        "pose_flange_board": PoseData.of(found.pose_flange_board).model_dump(mode="json"),
        "correction": _placed(correction),
        "values": _values([f"camera {name}" for name in names], np.zeros(6), sd[:6], half[:6])
        + _values([f"board {name}" for name in names], np.zeros(6), sd[6:], half[6:]),
        "covariance": found.fit.covariance.tolist(),
        "rms_px": float(off),
        "rms_mm": float(np.sqrt(np.mean(found.residual_mm**2))),
        "rms_deg": float(np.sqrt(np.mean(found.residual_deg**2))),
        "held_out_px": found.held_out_px * float(np.sqrt(2.0)),
        "held_out_mm": found.held_out_mm,
        "held_out_deg": found.held_out_deg,
        "pairs": found.fit.groups,
        "missing": missing,
        "doubts": doubts,
    }


def _placed(pose: Pose) -> dict[str, list[float]]:
    return {"shift_m": pose.translation_m.tolist(), "turn_rad": pose.rotvec_rad().tolist()}
