"""The differences between the cell behind the protocols and its file, drawn by a seed, and poses at which a person
holds the board.

Cameras, sensor, peg and joints differ as in `crosspih bench calibrations`. The lenses differ too: a camera's focal
length and principal point are not those of its data sheet.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crosspih_common.config import CameraSection, Workcell
from crosspih_common.config.board import BoardPattern
from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration, PoseData
from services.operator.bench.calibrations.scored import hidden
from services.operator.bench.cells.conditions import merged
from services.operator.calibrate.showing import drawn_before

BOARD = "5x4:0.026:0.018:DICT_4X4_50"  # that of docs/hardware/in-a-day.md
FOCAL_SHARE, MIDDLE_PX = 0.01, 3.0
HELD, TRIES, CLEAR_M = 80, 4000, 0.02  # poses; of the plate, with the hole at its middle


def behind(base: dict[str, Any], seed: int | None) -> dict[str, Any]:
    """The content of the file of the cell behind the protocols: `base` itself where nothing is to be hidden."""
    if seed is None:
        return base
    workcell = Workcell.model_validate(base["cell"])
    rng = np.random.default_rng([seed, 78])
    lens = workcell.camera
    focal = float(np.exp(rng.normal() * FOCAL_SHARE))
    middle = rng.normal(size=2) * MIDDLE_PX
    camera = {
        "fx_px": round(lens.fx_px * focal, 4), "fy_px": round(lens.fy_px * focal, 4),
        "cx_px": round(lens.cx_px + float(middle[0]), 4), "cy_px": round(lens.cy_px + float(middle[1]), 4),
    }  # fmt: skip
    differs = {"hardware": hidden(seed, workcell.arm().joints)["hardware"], "cell": {"camera": camera}}
    return merged(merged(base, differs), {"hardware": {"simulated": {"board": {"pattern": BOARD}}}})


def cameras_of(section: CameraSection, turned: Pose | None = None, right: Pose | None = None) -> CameraCalibration:
    """The cameras in a cell's file; `turned` and `right` are the deviations of the left and the right one."""
    model = {
        "width_px": section.width_px, "height_px": section.height_px, "fx_px": section.fx_px, "fy_px": section.fy_px,
        "cx_px": section.cx_px, "cy_px": section.cy_px,
    }  # fmt: skip
    left_model, right_model = (
        {**model, "distortion_model": "plumb_bob", "distortion": numbers} if any(numbers) else model
        for numbers in section.distortions()
    )
    beside, stands = Pose.from_translation([section.baseline_m, 0.0, 0.0]), section.pose_base_camera()
    told = {
        "left": left_model, "right": right_model,
        "pose_left_right": PoseData.of(beside if right is None else beside @ right),
        "pose_base_camera": PoseData.of(stands if turned is None else stands @ turned),
    }  # fmt: skip
    return CameraCalibration.model_validate(told)


def true_cameras(content: dict[str, Any]) -> CameraCalibration:
    """The cameras as they really are."""
    truth = content["hardware"]["simulated"]["truth"]
    return cameras_of(
        Workcell.model_validate(content["cell"]).camera,
        Pose.from_rotvec(truth["camera_turn_rad"], truth["camera_shift_m"]),
        Pose.from_rotvec(truth["right_turn_rad"], truth["right_shift_m"]),
    )


def held_by_hand(content: dict[str, Any], seed: int) -> list[list[list[float]]]:
    """Poses of the board in the base, [position_m, rotvec_rad], between cameras and plate, as a person shows it."""
    cameras, pattern = true_cameras(content), BoardPattern.of(BOARD)
    pose_base_camera = cameras.pose_base_camera.pose()
    hole = Workcell.model_validate(content["cell"]).hole_prior.pose_base_hole()
    into_hole, rng = hole.inverse(), np.random.default_rng([seed, 79])
    outline, found = pattern.outline_m(), []
    for _ in range(TRIES):
        drawn = drawn_before(cameras, pattern, rng)
        if drawn is None:
            continue
        pose = pose_base_camera @ drawn[0]
        if float(into_hole.apply(pose.apply(outline))[:, 2].max()) > -CLEAR_M:
            continue
        found.append([pose.translation_m.tolist(), pose.rotvec_rad().tolist()])
        if len(found) == HELD:
            break
    return found
