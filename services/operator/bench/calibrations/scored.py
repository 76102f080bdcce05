"""Results of calibrations in a simulated cell against its hidden truth: errors, intervals, and whether these contain
the errors.

Each uses the result of the one before, in the order in which one would do them: stereo, then hand-eye with those
cameras; the tip, then the sensor's mounting with that peg, then the stiffness with both.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.calibration.mount import fit_mount
from crosspih_common.calibration.presses import Pressed
from crosspih_common.calibration.stiffness import fit_stiffness
from crosspih_common.calibration.tcp import fit_tip
from crosspih_common.config import CellFile, Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration
from services.operator.bench.cells.conditions import merged
from services.operator.calibrate.folder import Taken, pair_job
from services.operator.calibrate.settings import mount_settings, tcp_settings
from services.operator.calibrate.taking import ask, doubt_of
from services.operator.locate.worker import OfflineVision

PATTERN = "7x5:0.018:0.013:DICT_4X4_50"
# the board beside the peg, its face along the flange's y
NOMINAL_BOARD = {"position_m": [0.045, 0.045, 0.077], "rotvec_rad": [1.2092, -1.2092, 1.2092]}
CAMERA_M, CAMERA_RAD, RIGHT_M, RIGHT_RAD, BOARD_M, BOARD_RAD = 0.003, 0.01, 0.0005, 0.005, 0.002, 0.025
PEG_M, SENSOR_M, SENSOR_RAD, STIFFNESS = 0.0003, 0.0004, 0.01, 0.15
# the required accuracy of each, in the unit of the table
WANTED = {"hand-eye, place": 0.5, "hand-eye, turn": 0.1, "mount, place": 0.1, "mount, turn": 0.1, "stiffness": 5.0}


def hidden(seed: int, joints: int) -> dict[str, Any]:
    """The overrides of a cell that differs from its file by errors drawn with the seed."""
    rng = np.random.default_rng([seed, 77])

    def drawn(size: float, count: int = 3) -> list[float]:
        return [round(float(value), 7) for value in rng.normal(size=count) * size]

    truth = {
        "camera_shift_m": drawn(CAMERA_M), "camera_turn_rad": drawn(CAMERA_RAD), "right_shift_m": drawn(RIGHT_M),
        "right_turn_rad": drawn(RIGHT_RAD), "peg_shift_m": drawn(PEG_M), "ft_shift_m": drawn(SENSOR_M),
        "ft_turn_rad": drawn(SENSOR_RAD),
        "joint_stiffness_factors": [round(float(np.exp(value)), 5) for value in rng.normal(size=joints) * STIFFNESS],
    }  # fmt: skip
    nominal = Pose.from_rotvec(NOMINAL_BOARD["rotvec_rad"], NOMINAL_BOARD["position_m"])
    real = nominal @ Pose.from_rotvec(drawn(BOARD_RAD), drawn(BOARD_M))
    board = {"position_m": real.translation_m.tolist(), "rotvec_rad": real.rotvec_rad().tolist()}
    return {
        "hardware": {
            "simulated": {"seed": seed, "truth": truth, "board": {"pattern": PATTERN, "pose_flange_board": board}}
        },
        "operator": {"board": {"pattern": PATTERN, "pose_flange_board": NOMINAL_BOARD}},
    }


def _row(name: str, off: Array, half: Array, factor: float, unit: str) -> dict[str, Any]:
    """Errors and half of the 95 % intervals, for the table."""
    off, half = np.atleast_1d(off) * factor, np.atleast_1d(half) * factor
    return {
        "name": name, "unit": unit, "off": [float(value) for value in off], "half_95": [float(one) for one in half],
        "inside": [bool(one) for one in np.abs(off) <= half],
    }  # fmt: skip


def pictures_scored(
    taken: Taken, folder: Path, vision: OfflineVision, workcell: Workcell, truth: dict[str, Any]
) -> list[dict[str, Any]]:
    """Stereo, and hand-eye with its cameras, against the truth. Raises CalibrationRefused, ConfigError."""
    told_of = taken.calibration
    if told_of is None:
        raise ConfigError(f"{folder}: the pairs say nothing of the cameras")
    jobs = [pair_job(pair, folder, "linear") for pair in taken.pairs]
    stereo = ask(vision, {"do": "stereo", "board": taken.board, "pairs": jobs})
    arm = workcell.arm()
    flanges = [arm.pose_base_flange(pair.joints_rad or ()).matrix().tolist() for pair in taken.pairs]
    cameras = {**stereo["calibration"], "pose_base_camera": told_of.pose_base_camera.model_dump(mode="json")}
    job = {"do": "hand_eye", "board": taken.board, "pairs": jobs, "flanges": flanges, "calibration": cameras,
           "doubt": doubt_of(stereo)}  # fmt: skip
    eye = ask(vision, job)
    found = CameraCalibration.model_validate(cameras)
    right = told_of.pose_left_right.pose() @ Pose.from_rotvec(truth["right_turn_rad"], truth["right_shift_m"])
    off = right.inverse() @ found.pose_left_right.pose()
    half = {one["name"]: one["half_95"] for one in stereo["values"]}
    focal = [[model.fx_px, model.fy_px, model.cx_px, model.cy_px] for model in (found.left, told_of.left)]
    rows = [
        _row("stereo, focal length", np.array(focal[0])[:2] - np.array(focal[1])[:2],
             np.array([half["left fx"], half["left fy"]]), 1.0, "px"),
        _row("stereo, right camera's place", off.translation_m,
             np.array([half[f"right {axis}"] for axis in "xyz"]), 1e3, "mm"),
        _row("stereo, right camera's turn", off.rotvec_rad(),
             np.array([half[f"right r{axis}"] for axis in "xyz"]), 180.0 / np.pi, "°"),
    ]  # fmt: skip
    real = told_of.pose_base_camera.pose() @ Pose.from_rotvec(truth["camera_turn_rad"], truth["camera_shift_m"])
    left = CameraCalibration.model_validate({**cameras, "pose_base_camera": eye["pose_base_camera"]})
    astray = real.inverse() @ left.pose_base_camera.pose()
    wide = [one["half_95"] for one in eye["values"][:6]]
    rows += [
        _row("hand-eye, place", astray.translation_m, np.array(wide[3:]), 1e3, "mm"),
        _row("hand-eye, turn", astray.rotvec_rad(), np.array(wide[:3]), 180.0 / np.pi, "°"),
    ]
    return [{**row, "pairs": len(taken.pairs), "held_out_px": eye["held_out_px"]} for row in rows]


def _with(cell: CellFile, settings: dict[str, Any], content: dict[str, Any]) -> tuple[CellFile, dict[str, Any]]:
    after = merged(content, {"cell": settings["cell"]})
    return CellFile(cell.path, cell.text, Workcell.model_validate(after.get("cell") or {}), cell.sections), after


def pushes_scored(
    pressed: Pressed, cell: CellFile, content: dict[str, Any], truth: dict[str, Any]
) -> list[dict[str, Any]]:
    """Tip, mounting and stiffness, each with the result of the one before, against the truth. `content` is the cell's
    file as a mapping. Raises CalibrationRefused.
    """
    tip = fit_tip(pressed, cell.workcell)
    shifted, content = _with(cell, tcp_settings(tip, cell), content)
    mount = fit_mount(pressed, shifted.workcell)
    # the sensor as it was mounted, in the frame of the peg as found
    real = Pose.from_rotvec(truth["ft_turn_rad"], np.asarray(truth["ft_shift_m"]) - tip.shift_m)
    mounted, _ = _with(shifted, mount_settings(mount, shifted), content)
    stiff = fit_stiffness(pressed, mounted.workcell)
    drawn = np.asarray(cell.workcell.joint_stiffness_nm_rad, float)
    share = stiff.stiffness_nm_rad / (drawn * np.asarray(truth["joint_stiffness_factors"])) - 1.0
    fixed = np.array(stiff.taken)
    turn = (real.inverse() @ mount.pose_peg_sensor).rotvec_rad()
    rows = [
        _row("tcp, tip", tip.shift_m - np.asarray(truth["peg_shift_m"]), tip.half_m, 1e3, "mm"),
        _row("mount, place", mount.pose_peg_sensor.translation_m - real.translation_m, mount.shift_half_m, 1e3, "mm"),
        _row("mount, turn", turn, mount.turn_half_rad, 180.0 / np.pi, "°"),
        _row("stiffness", share[fixed], stiff.half_share[fixed], 1e2, "%"),
        {"name": "stiffness, joints left open", "unit": "", "open": [int(one) + 1 for one in np.flatnonzero(~fixed)]},
    ]
    return [{**row, "pushes": len(pressed.presses)} for row in rows]
