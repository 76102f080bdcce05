"""What the simulated cell really is, where it differs from what the services are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import ConvexPiece, CrossPeg, Hole, Peg
from services.hardware.drivers.simulated.config import TruthConfig


def true_peg(workcell: Workcell, truth: TruthConfig) -> Peg:
    """The peg as it was made: body, taper start and tip plane as drawn, the taper's slope not quite."""
    peg: Peg = workcell.peg.shape()
    if truth.taper_slope_factor == 1.0:
        return peg
    apex_m = peg.taper_start_m + (peg.apex_m - peg.taper_start_m) / truth.taper_slope_factor
    if isinstance(peg, CrossPeg):
        slope = peg.taper_slope * truth.taper_slope_factor
        return replace(peg, taper_slope=slope, apex_m=apex_m, tip_half_width_m=slope * (apex_m - peg.tip_m))
    return replace(peg, apex_m=apex_m)


def true_hole(workcell: Workcell, truth: TruthConfig) -> Hole:
    """The hole as it was made: around the drawn body, with a clearance that is not quite the drawn one."""
    drawing = workcell.hole
    if truth.clearance_offset_m != 0.0:
        drawing = drawing.model_copy(update={"clearance_m": drawing.clearance_m + truth.clearance_offset_m})
    return drawing.shape(workcell.peg.shape())


def true_stiffness_nm_rad(workcell: Workcell, truth: TruthConfig) -> Array:
    """The joints' stiffness (6,) as it is."""
    stiffness = np.asarray(workcell.joint_stiffness_nm_rad, float) * truth.joint_stiffness_factor
    if truth.joint_stiffness_factors is None:
        return np.asarray(stiffness, dtype=float)
    factors = np.asarray(truth.joint_stiffness_factors, float)
    if factors.shape != stiffness.shape:
        raise ConfigError(
            f"hardware.simulated.truth.joint_stiffness_factors: has {len(factors)} numbers, give {len(stiffness)}"
        )
    return np.asarray(stiffness * factors, dtype=float)


def true_pieces(workcell: Workcell, truth: TruthConfig) -> list[ConvexPiece]:
    """The peg's convex pieces in the peg frame, where its holder really has them."""
    shift = np.asarray(truth.peg_shift_m, float)
    pieces = true_peg(workcell, truth).pieces()
    if not shift.any():
        return pieces
    return [ConvexPiece(piece.normals, piece.offsets_m + piece.normals @ shift) for piece in pieces]


def true_right_camera(pose_left_right: Pose, truth: TruthConfig) -> Pose:
    """Where the right camera really stands, in the left one's frame."""
    if not any((*truth.right_shift_m, *truth.right_turn_rad)):
        return pose_left_right
    return pose_left_right @ Pose.from_rotvec(truth.right_turn_rad, truth.right_shift_m)


def true_camera(pose_base_camera: Pose, truth: TruthConfig) -> Pose:
    """Where the left camera really stands; `pose_base_camera` is where the calibration says."""
    if not any((*truth.camera_shift_m, *truth.camera_turn_rad)):
        return pose_base_camera
    return pose_base_camera @ Pose.from_rotvec(truth.camera_turn_rad, truth.camera_shift_m)


class TrueSensorMounting:
    """The F/T sensor as it was bolted on: its frame against the peg frame that the services take it for."""

    def __init__(self, truth: TruthConfig) -> None:
        self._true = not any((*truth.ft_shift_m, *truth.ft_turn_rad))
        self._pose_peg_sensor = Pose.from_rotvec(truth.ft_turn_rad, truth.ft_shift_m)

    def felt(self, wrench: Array) -> Array:
        """What it feels (6,) of a wrench (6,) that the peg frame has, in its own frame about its own origin."""
        if self._true:
            return wrench
        turn, shift = self._pose_peg_sensor.rotation, self._pose_peg_sensor.translation_m
        force, moment = wrench[:3], wrench[3:]
        return np.concatenate([force @ turn, (moment - np.cross(shift, force)) @ turn])
