"""The hole's pose once the peg is seated: the peg's own pose, within the clearance, fused with the earlier estimate."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole, Peg
from services.inference.estimator.bore import BoreWalls

UNKNOWN_DEPTH_SD_M = 1.0
UNKNOWN_TURN_SD_RAD = 3.0
CALIBRATION_SD_M = 2e-5
# A wall force well above the noise of a reading (0.3 N at 15 mm of lever) says that the wall is touched.
TOUCHING_FORCE_N = 1.0


class NotSeated(ValueError):
    """The peg's body is not in the hole."""


def final_estimate(
    peg: Peg,
    hole: Hole,
    pose_base_hole: Pose,
    covariance: Array,
    pose_base_peg: Pose,
    wrench_peg: Array,
    compliance_peg: Array,
) -> tuple[Pose, Array]:
    """The hole's pose and covariance (6, 6) after the insertion.

    pose_base_hole, covariance: the posterior before. pose_base_peg: motor-side pose of the seated peg; wrench_peg (6,)
    and compliance_peg (6, 6) give its deflection. At the rim and at the body's leading end the peg lies anywhere within
    the clearance, uniformly, unless the wrench says which wall it leans on. That measures the lateral position, the
    tilt and the turn, but not the depth.
    Raises NotSeated when the peg's body is not in the hole.
    """
    twist = np.asarray(compliance_peg, float) @ np.asarray(wrench_peg, float)
    seated = pose_base_peg @ Pose.from_rotvec(twist[3:], twist[:3])
    # The peg relative to the estimated hole: only its depth is taken from there.
    rim_z = (seated.inverse() @ pose_base_hole).translation_m[2]
    entered = peg.taper_start_m - rim_z - hole.chamfer_m
    if entered <= 0.0:
        raise NotSeated(
            f"the peg's body is {-entered * 1e3:.1f} mm short of the bore: "
            "push it in before asking for the final estimate"
        )
    walls = BoreWalls.of(peg, hole)
    lever = _turning_lever_m(walls)
    wrench = np.asarray(wrench_peg, float)
    rim_end, _leading_end = rim_z + hole.chamfer_m, peg.taper_start_m
    force_leading = (np.array([wrench[4], -wrench[3]]) - rim_end * wrench[:2]) / entered
    force_rim = wrench[:2] - force_leading
    # The rest of the moment about z, as a force at the wall that holds the turn best.
    force_turn = wrench[5] / lever
    # Hole against peg: (x, y) at the rim end, (x, y) at the leading end, and along the turn at the lever's end.
    play_x, play_y = (_lateral_play_m(walls, axis) for axis in (0, 1))
    play = np.array([play_x, play_y, play_x, play_y, walls.clearance_m])
    offset, variance = _play(np.array([*force_rim, *force_leading, force_turn]), play)
    to_pose = np.zeros((6, 5))
    for axis, tilt_axis, sign in ((0, 4, 1.0), (1, 3, -1.0)):
        to_pose[tilt_axis, [axis, axis + 2]] = sign * np.array([-1.0, 1.0]) / entered
        to_pose[axis, [axis, axis + 2]] = np.array([1.0, 0.0]) - hole.chamfer_m * np.array([-1.0, 1.0]) / entered
    to_pose[5, 4] = 1.0 / lever
    shift = to_pose @ offset
    mean = seated @ Pose.from_translation([0.0, 0.0, rim_z]) @ Pose.from_rotvec(shift[3:], shift[:3])
    seat_covariance = (to_pose * variance) @ to_pose.T
    seat_covariance[2, 2] += UNKNOWN_DEPTH_SD_M**2
    if not walls.turn_fixed:
        seat_covariance[5, 5] += UNKNOWN_TURN_SD_RAD**2
    return _fused(pose_base_hole, np.asarray(covariance, float), mean, seat_covariance)


def _turning_lever_m(walls: BoreWalls) -> float:
    """The lever about the axis of the wall that limits the peg's turn the most, m."""
    levers = np.abs(walls.points(0.0)[:, 4])
    return float(walls.clearance_m / np.min(walls.clearances_m / np.maximum(levers, 1e-6)))


def _lateral_play_m(walls: BoreWalls, axis: int) -> float:
    """The travel of the centred peg along x (0) or y (1), the farther of both ways, m."""
    ways = []
    for sign in (1.0, -1.0):
        closing = np.maximum(-sign * walls.normals[:, axis], 1e-9)
        ways.append(float(np.min(walls.clearances_m / closing)))
    return max(ways)


def _play(force_n: Array, play_m: Array) -> tuple[Array, Array]:
    """Offset of the hole against the peg (m) and its variance, for each direction with a force from a wall.

    Without a force the offset is uniform in +-play. A wall that presses the peg towards + is touched on the - side, so
    the hole is a whole play towards +. In between either may be true, and the variance includes the spread of the two.
    """
    touching = force_n**2 / (force_n**2 + TOUCHING_FORCE_N**2)
    offset = np.sign(force_n) * touching * play_m
    spread = (1.0 - touching) / 3.0 + touching * (1.0 - touching)
    return offset, spread * play_m**2 + CALIBRATION_SD_M**2


def _fused(first: Pose, first_covariance: Array, second: Pose, second_covariance: Array) -> tuple[Pose, Array]:
    """The product of two Gaussians over poses (right perturbations), linearised at `first`.

    Where they disagree beyond 4 sigma (in any of the five directions the seat measures) the first is widened, because
    the seat is a fact and the posterior an inference.
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
