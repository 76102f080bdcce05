"""The hole's depth and tilt without a picture: by three touches of the face beside it.

The drawing knows the hole to some centimetres and hundredths of a radian. Three touches of the face beside the hole
leave its lateral place and its turn about the axis to be found: depth and tilt are then known.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Failure, Phase, PoseData, PosePrior, Touch, floats
from services.planning.leaving import withdraw
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.touching import deflected, touch_from

FACE_DEPTH_SD_M = 3e-4
FACE_TILT_SD_RAD = 5e-3
# three corners of a square about the hole, on the plate and clear of the hole wherever it is within the drawing's range
CORNERS = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0))
EDGE_M = 0.004  # from the tip to the plate's edge, at least
FACE_SPEED_M_S = 0.005  # the face is hard
SPARE_M = 0.003


def pose_by_face_touches(run: Run) -> PosePrior:
    """The hole as drawn, moved and tilted onto the face that was felt; the peg stands before it."""
    nominal, half_ranges = run.workcell.hole_prior.pose_base_hole(), run.workcell.hole_prior.half_ranges()
    peg = run.workcell.peg.shape()
    hole = run.workcell.hole.shape(peg)
    tip_radius_m = float(np.linalg.norm(peg.outline_m(peg.tip_m)[:, :2], axis=1).max())
    beside_m = hole.plate_half_size_m - float(half_ranges[0]) - tip_radius_m - EDGE_M
    slope = float(np.sqrt(2.0) * half_ranges[3])
    run.tell(Phase.TOUCHING, "without a picture: three touches of the face give its depth and tilt")
    points: list[Array] = []
    for x, y in CORNERS:
        spot = np.array([beside_m * x, beside_m * y, -half_ranges[2] - slope * beside_m])
        if points:
            # the last one says how deep the face is, but for its tilt
            last = nominal.inverse().apply(points[-1])
            spot[2] = last[2] - slope * np.linalg.norm(last[:2] - spot[:2]) - SPARE_M
        else:
            run.motion.approach(nominal @ Pose.from_translation(spot))
        points.append(_touch_the_face(run, nominal @ Pose.from_translation(spot)))
    pose = on_the_face(nominal, np.array(points))
    run.hole.believed = pose
    variances = half_ranges**2 / 3.0
    variances[2:5] = FACE_DEPTH_SD_M**2, FACE_TILT_SD_RAD**2, FACE_TILT_SD_RAD**2
    withdraw(run, pose, run.config.approach_m)
    run.motion.slide_to(run.motion.before_hole(pose, run.config.standoff_m), run.config.line_speed_m_s)
    return PosePrior(pose_base_hole=PoseData.of(pose), covariance=floats(np.diag(variances)))


def _touch_the_face(run: Run, spot: Pose) -> Array:
    """The point (3,) of the face that the tip touches, in the base frame, m."""
    tip_m = run.workcell.peg.shape().tip_m
    for further_m in (0.0, 0.8 * run.config.touch_travel_m):
        start = spot @ Pose.from_translation([0.0, 0.0, further_m - tip_m])
        touch = touch_from(run, start, spot.rotation[:, 2], FACE_SPEED_M_S, run.config.touch_threshold_n)
        if touch is not None:
            return deflected(run, touch).apply(where_the_tip_touches(touch, tip_m))
    raise AssemblyFailed(Failure.NOT_SEEN, "the plate was neither seen nor felt")


def where_the_tip_touches(touch: Touch, tip_m: float) -> Array:
    """Where the line of action of a touch meets the tip's face, (3,) in the peg frame, m."""
    fx, fy, fz, mx, my, _ = touch.wrench
    if abs(fz) < 1e-6:
        return np.array([0.0, 0.0, tip_m])
    return np.array([(tip_m * fx - my) / fz, (mx + tip_m * fy) / fz, tip_m])


def on_the_face(pose_base_hole: Pose, points_m: Array) -> Pose:
    """The hole moved along its axis, and turned the shortest way, onto the plane through three points (3, 3), m."""
    axis = pose_base_hole.rotation[:, 2]
    normal = np.cross(points_m[1] - points_m[0], points_m[2] - points_m[0])
    normal /= np.linalg.norm(normal) * np.sign(normal @ axis)
    turn = Rotation.align_vectors(normal[None, :], axis[None, :])[0].as_matrix()
    along_m = float((points_m[0] - pose_base_hole.translation_m) @ normal / (axis @ normal))
    return Pose(turn @ pose_base_hole.rotation, pose_base_hole.translation_m + axis * along_m)
