"""The hole's pose once the peg sits in it: the peg's own pose, within the clearance, fused with what was known before."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import CrossHole, CrossPeg

UNKNOWN_DEPTH_SD_M = 1.0
CALIBRATION_SD_M = 2e-5


def final_estimate(
    peg: CrossPeg,
    hole: CrossHole,
    pose_base_hole: Pose,
    covariance: Array,
    pose_base_peg: Pose,
    wrench_peg: Array,
    compliance_peg: Array,
) -> tuple[Pose, Array]:
    """The hole's pose and covariance (6, 6) after the insertion.

    pose_base_hole, covariance: the posterior before. pose_base_peg: motor-side pose of the seated peg; wrench_peg (6,)
    and compliance_peg (6, 6) give its deflection. At the rim and at the body's leading end the peg lies anywhere within
    the clearance, uniformly; that makes a lateral, a tilt and a turn, and says nothing of the depth.
    Raises ValueError when the peg's body is not in the hole.
    """
    twist = np.asarray(compliance_peg, float) @ np.asarray(wrench_peg, float)
    seated = pose_base_peg @ Pose.from_rotvec(twist[3:], twist[:3])
    # The peg seen from the hole as known: only its depth is taken from there.
    rim_z = (seated.inverse() @ pose_base_hole).translation_m[2]
    entered = peg.taper_start_m - rim_z - hole.chamfer_m
    if entered <= 0.0:
        raise ValueError(
            f"the peg's body is {-entered * 1e3:.1f} mm short of the bore: push it in before asking for the final estimate"
        )
    clearance = hole.half_width_m - peg.half_width_m
    mean = seated @ Pose.from_translation([0.0, 0.0, rim_z])
    lateral = (clearance**2 / 3.0) + CALIBRATION_SD_M**2
    # Hole axis against the peg's at z = chamfer (a) and z = chamfer + entered (b), per direction: x = a - c tilt.
    tilt_of_ends = np.array([-1.0, 1.0]) / entered
    origin_of_ends = np.array([1.0, 0.0]) - hole.chamfer_m * tilt_of_ends
    mapping = np.zeros((6, 4))
    mapping[0, :2] = origin_of_ends
    mapping[4, :2] = tilt_of_ends
    mapping[1, 2:] = origin_of_ends
    mapping[3, 2:] = -tilt_of_ends
    seat_covariance = mapping @ mapping.T * lateral
    seat_covariance[2, 2] = UNKNOWN_DEPTH_SD_M**2
    seat_covariance[5, 5] = lateral / peg.half_length_m**2
    return _fused(pose_base_hole, np.asarray(covariance, float), mean, seat_covariance)


def _fused(first: Pose, first_covariance: Array, second: Pose, second_covariance: Array) -> tuple[Pose, Array]:
    """The product of two Gaussians over poses (right perturbations), linearised at `first`.

    Where they disagree beyond 4 sigma (in any of the five directions the seat measures) the first is widened: the seat
    is a fact, the posterior an inference.
    """
    between = first.inverse() @ second
    error = np.concatenate([between.translation_m, between.rotvec_rad()])
    # Second's covariance in the first's frame: its translation is measured along its own axes.
    turn = np.eye(6)
    turn[:3, :3] = between.rotation
    moved = turn @ second_covariance @ turn.T
    distance = float(error @ np.linalg.solve(first_covariance + moved, error))
    widened = first_covariance * max(1.0, distance / 16.0)
    gain = widened @ np.linalg.inv(widened + moved)
    move = gain @ error
    covariance = widened - gain @ widened
    pose = first @ Pose(Rotation.from_rotvec(move[3:]).as_matrix(), move[:3])
    return pose, np.asarray(0.5 * (covariance + covariance.T))
