"""Residuals of presses against the bore: which walls the wrench says are touched, and how far the peg is from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import transform_wrench
from services.inference.estimator import BoreWalls, PressSettings
from services.inference.estimator.bore import PLANE
from services.inference.refine.parameters import CLEARANCE

GAP_SD_M = 1.2e-5  # of the arm's pose and the wall, at the far end of an arm of the cross
TOUCHING_N = 0.7  # a wall that presses with much more is touched
NEAR_M = 1.5e-4


@dataclass(frozen=True, slots=True, eq=False)
class PressModel:
    """What one press says: points (K, 5) of the walls that matter, their clearances as drawn (K,), how surely each is
    touched (K,), how far it gives way to its force (K,), m, and the heights of rim and leading end in the hole, m."""

    points: Array
    clearances_m: Array
    touched: Array
    yields_m: Array
    wrench_sd: Array

    @classmethod
    def of(
        cls, walls: BoreWalls, chamfer_m: float, taper_start_m: float, pose_hole_peg: Pose, wrench_peg: Array,
        clearance_offset_m: float, settings: PressSettings,
    ) -> PressModel:  # fmt: skip
        """Judge it at a pose."""
        leading = float(pose_hole_peg.apply([0.0, 0.0, taper_start_m])[2])
        points = np.concatenate([walls.points(chamfer_m), walls.points(leading)])
        clearances = np.tile(walls.clearances_m, 2)
        wrench = transform_wrench(pose_hole_peg, wrench_peg)[PLANE]
        friction = float(np.linalg.norm(wrench[:2])) * settings.friction_share
        force_sd, moment_sd = np.hypot(settings.force_sd_n, friction), np.hypot(settings.moment_sd_nm, friction * 0.05)
        sd = np.array([force_sd, force_sd, moment_sd, moment_sd, moment_sd])
        force, _ = nnls((points / sd).T, wrench / sd)
        gap = clearances + clearance_offset_m + points @ displacement(pose_hole_peg)
        touched = force**2 / (force**2 + TOUCHING_N**2)
        keep = (touched > 0.1) | (gap < NEAR_M)
        return cls(
            points[keep], clearances[keep], np.where(touched > 0.1, touched, 0.0)[keep],
            force[keep] / settings.wall_stiffness_n_m, sd,
        )  # fmt: skip

    def residual(self, pose_hole_peg: Pose, wrench_peg: Array, parameters: Array) -> Array:
        """(5 + K,): wrench that the touched walls leave, and gaps (of the others what overlaps), in sds."""
        gap = self.clearances_m + parameters[CLEARANCE] + self.points @ displacement(pose_hole_peg)
        away = np.where(self.touched > 0.0, self.touched * (gap + self.yields_m), np.minimum(gap, 0.0)) / GAP_SD_M
        basis = (self.points[self.touched > 0.0] / self.wrench_sd).T
        target = transform_wrench(pose_hole_peg, wrench_peg)[PLANE] / self.wrench_sd
        left = target
        if basis.shape[1]:
            force, *_ = np.linalg.lstsq(basis, target, rcond=1e-6)
            left = target - basis @ force
        return np.concatenate([left, away])


def displacement(pose_hole_peg: Pose) -> Array:
    """(5,): how far the peg's axis is from the hole's at the face, m, and turned, rad."""
    back = pose_hole_peg.inverse().translation_m
    axis_at_face = pose_hole_peg.apply([0.0, 0.0, float(back[2])])
    return np.concatenate([axis_at_face[:2], pose_hole_peg.rotvec_rad()])
