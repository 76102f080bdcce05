"""Residuals of presses against the bore: the distance of the peg from the walls that its force points to.

A force clearly points to the walls it presses on, but, because of friction, hardly shows at which height. So of the
points where such a wall may be touched the nearest is assumed to touch, and no other may overlap. A single tilt of the
peg cannot separate clearance and tilt of the hole (play = 2 c - tilt x length); vision's tilt over many assemblies can.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.inference.cell_refinement.parameters import CLEARANCE
from services.inference.estimator import BoreWalls

GAP_SD_M = 1e-5  # of the arm's pose and the wall, at the far end of an arm of the cross
TOUCHING_N = 1.0  # a wall is touched when it presses with more, and with more than friction can
TOUCHING_SHARE = 0.3
YIELDS_M_N = 5e-7
NEAR_M = 3e-4


@dataclass(frozen=True, slots=True, eq=False)
class PressModel:
    """The model of one press: points (K, 5) of the walls that matter, their drawn clearances (K,), m, which are touched
    (K,), and the deflection of each under its force (K,), m."""

    points: Array
    clearances_m: Array
    touched: NDArray[np.bool_]
    yields_m: Array

    @classmethod
    def of(
        cls,
        walls: BoreWalls,
        chamfer_m: float,
        taper_start_m: float,
        pose_hole_peg: Pose,
        wrench_peg: Array,
        clearance_offset_m: float,
    ) -> PressModel:
        """Choose the touched walls at a pose."""
        leading = float(pose_hole_peg.apply([0.0, 0.0, taper_start_m])[2])
        points = np.concatenate([walls.points(chamfer_m), walls.points(leading)])
        clearances = np.tile(walls.clearances_m, 2)
        force = pose_hole_peg.rotate(wrench_peg[:3])[:2]
        ways, which = np.unique(np.round(walls.normals, 6), axis=0, return_inverse=True)
        presses, _ = nnls(ways.T, force)
        gap = clearances + clearance_offset_m + points @ displacement(pose_hole_peg)
        touched, yields = np.zeros(len(gap), dtype=bool), np.zeros(len(gap))
        for way in np.flatnonzero(presses > max(TOUCHING_N, TOUCHING_SHARE * float(np.linalg.norm(force)))):
            there = np.flatnonzero(np.tile(which.ravel() == way, 2))
            nearest = there[np.argmin(gap[there])]
            touched[nearest], yields[nearest] = True, presses[way] * YIELDS_M_N
        keep = touched | (gap < NEAR_M)
        return cls(points[keep], clearances[keep], touched[keep], yields[keep])

    def residual(self, pose_hole_peg: Pose, parameters: Array) -> Array:
        """(K,): gaps of the touching points and overlaps of the others, in sds."""
        gap = self.clearances_m + parameters[CLEARANCE] + self.points @ displacement(pose_hole_peg)
        return np.asarray(np.where(self.touched, gap + self.yields_m, np.minimum(gap, 0.0)) / GAP_SD_M)


def displacement(pose_hole_peg: Pose) -> Array:
    """(5,): offset of the peg's axis from the hole's at the face, m, and its rotation, rad."""
    back = pose_hole_peg.inverse().translation_m
    axis_at_face = pose_hole_peg.apply([0.0, 0.0, float(back[2])])
    return np.concatenate([axis_at_face[:2], pose_hole_peg.rotvec_rad()])
