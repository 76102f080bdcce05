"""Checks the cell's file by its own drawings: does the peg fit, does the arm reach, do the cameras see?
Nothing moves.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from crosspih_common.arm.inverse import InverseError, nearest, solver
from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, CameraModel, DistortionModel
from services.operator.cli.rows import Row, ok, warning, wrong

APPROACH_M = 0.06  # where the straight way to the hole begins; the default of services/planning/config.py
NEAR_LIMIT_RAD = 0.05
SMALL_PX = 40.0
MARGIN_PX = 5.0


def fit_rows(cell: Workcell) -> Iterator[Row]:
    """Peg and hole by their drawings and tolerances."""
    clearance, sd = cell.hole.clearance_m, cell.hole.tolerance.size_m
    found = f"clearance {clearance * 1e3:.3f} mm a side, the hole's size known to {sd * 1e3:.3f} mm (one sd)"
    if sd >= clearance:
        yield wrong("peg in hole", f"{found}: one hole in six is smaller than the peg", "mend cell.hole.clearance_m, "
                    "or cell.hole.tolerance.size_m: of +-t write t / 2")  # fmt: skip
    elif 2.0 * sd > clearance:
        yield warning("peg in hole", f"{found}: some holes are smaller than the peg", "measure the hole, and give "
                      "cell.hole.tolerance.size_m")  # fmt: skip
    else:
        yield ok("peg in hole", found)
    peg = cell.peg.shape()
    body_m = peg.taper_start_m - peg.body_start_m
    most_m = body_m - cell.hole.chamfer_m
    found = f"{cell.insertion_depth_m * 1e3:.1f} mm are wanted of a body of {body_m * 1e3:.1f} mm"
    if cell.insertion_depth_m > most_m:
        yield wrong("insertion depth", found, f"cell.insertion_depth_m: at most {most_m:.4f}")
    else:
        yield ok("insertion depth", found)


def poses_of_prior(cell: Workcell) -> list[Pose]:
    """The nominal hole, then the 32 corners of its prior: lateral, deep, turned."""
    nominal, half = cell.hole_prior.pose_base_hole(), cell.hole_prior.half_ranges()
    corners = []
    for x, y, z, turn_x, turn_y in product((-1.0, 1.0), repeat=5):
        turn = np.array([turn_x * half[3], turn_y * half[4], 0.0])
        corners.append(nominal @ Pose.from_rotvec(turn, np.array([x, y, z]) * half[:3]))
    return [nominal, *corners]


def reach_rows(cell: Workcell, approach_m: float = APPROACH_M) -> Iterator[Row]:
    """Before the hole, where the straight way begins, and seated: at the nominal pose and every corner of the prior."""
    peg, back = cell.peg.shape(), cell.pose_flange_peg().inverse()
    before = Pose.from_translation([0.0, 0.0, -(peg.tip_m + approach_m)])
    seated = Pose.from_translation([0.0, 0.0, cell.insertion_depth_m + cell.hole.chamfer_m - peg.taper_start_m])
    arm, seed = cell.arm(), np.asarray(cell.home_joints_rad, dtype=float)
    reached, lost = [], []
    for index, hole in enumerate(poses_of_prior(cell)):
        try:
            joints = nearest(arm, hole @ before @ back, seed)
            reached += [joints, nearest(arm, hole @ seated @ back, joints)]
        except InverseError as error:
            lost.append((index, str(error)))
    mend = "move the hole or the base; cell.hole_prior, cell.flange_to_ft and cell.arm say where all is"
    if lost and lost[0][0] == 0:
        yield wrong("reach", f"the arm does not reach the nominal hole: {lost[0][1]}", mend)
        return
    if lost:
        yield warning("reach", f"of 32 corners of the hole's range {len(lost)} are out of reach: {lost[0][1]}", mend)
    else:
        yield ok("reach", "the arm reaches the hole, before and seated, at all 32 corners of its range")
    yield _limits_row(cell, np.array(reached))


def _limits_row(cell: Workcell, joints: Array) -> Row:
    limits = cell.arm().limits
    room = np.minimum(joints - limits.lower_rad, limits.upper_rad - joints)
    joint = int(np.argmin(room.min(axis=0)))
    least = float(room[:, joint].min())
    singular = next((said for row in joints if (said := solver(cell.arm()).singular(row))), "")
    if singular:
        return warning("joints at the hole", f"nearly singular there: {singular}", "stand the plate elsewhere")
    found = f"joint {joint + 1} comes within {least:.2f} rad of its limit"
    if least < NEAR_LIMIT_RAD:
        return warning("joints at the hole", found, "stand the plate elsewhere, or another cell.home_joints_rad")
    return ok("joints at the hole", found)


def camera_rows(cell: Workcell, told: CameraCalibration | None) -> Iterator[Row]:
    """Whether both cameras see the hole wherever it may be; `told` is the calibration that running cameras publish."""
    name = "cameras see the hole"
    if told is None:
        section = cell.camera
        lenses = section.distortions()
        left, right = (_model(cell, numbers) for numbers in lenses)
        base_left = section.pose_base_camera()
        base_right = base_left @ Pose.from_translation([section.baseline_m, 0.0, 0.0])
    else:
        left, right = told.left, told.right
        base_left = told.pose_base_camera.pose()
        base_right = base_left @ told.pose_left_right.pose()
    rim = np.asarray(cell.hole.shape(cell.peg.shape()).outer_rim_m(), dtype=float)
    poses = poses_of_prior(cell)
    unseen = []
    sizes = []
    for index, hole in enumerate(poses):
        for side, camera, pose in (("left", left, base_left), ("right", right, base_right)):
            seen = projected(camera, pose.inverse(), np.array([hole.apply(point) for point in rim]))
            if seen is None:
                unseen.append((index, side))
            else:
                sizes.append(float(np.ptp(seen, axis=0).max()))
    mend = "turn or move the cameras, or mend cell.camera (crosspih calibrate hand-eye)"
    nominal = [side for index, side in unseen if index == 0]
    if nominal:
        yield wrong(name, f"the nominal hole is not in the {' and the '.join(nominal)} picture", mend)
    elif unseen:
        corners = len({index for index, _ in unseen})
        yield warning(name, f"at {corners} of 32 corners of its range the hole is not whole in both pictures", mend)
    elif min(sizes) < SMALL_PX:
        yield warning(name, f"it is {min(sizes):.0f} pixels wide at the least", "bring the cameras nearer")
    else:
        yield ok(name, f"at all 32 corners of its range, {min(sizes):.0f} to {max(sizes):.0f} pixels wide")


def _model(cell: Workcell, numbers: tuple[float, ...]) -> CameraModel:
    section = cell.camera
    return CameraModel(
        width_px=section.width_px, height_px=section.height_px, fx_px=section.fx_px, fy_px=section.fy_px,
        cx_px=section.cx_px, cy_px=section.cy_px, distortion=numbers,
        distortion_model=DistortionModel.PLUMB_BOB if any(numbers) else DistortionModel.NONE,
    )  # fmt: skip


def projected(camera: CameraModel, pose_camera_base: Pose, points_base_m: Array) -> Array | None:
    """Pixels (n, 2) of points (n, 3); None where one is behind the camera or outside its picture."""
    points = np.array([pose_camera_base.apply(point) for point in points_base_m])
    if np.any(points[:, 2] <= 0.01):
        return None
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    if camera.distortion_model is DistortionModel.FISHEYE:
        k1, k2, k3, k4 = camera.distortion
        radius = np.maximum(np.hypot(x, y), 1e-12)
        angle = np.arctan(radius)
        bent = angle * (1.0 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8) / radius
        x, y = x * bent, y * bent
    else:
        k1, k2, p1, p2, k3, k4, k5, k6 = (*camera.distortion, *(0.0,) * (8 - len(camera.distortion)))
        r2 = x**2 + y**2
        bent = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        x, y = (
            x * bent + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x**2),
            y * bent + p1 * (r2 + 2.0 * y**2) + 2.0 * p2 * x * y,
        )
    pixels = np.column_stack([camera.fx_px * x + camera.cx_px, camera.fy_px * y + camera.cy_px])
    inside = np.all((pixels >= MARGIN_PX) & (pixels <= np.array([camera.width_px, camera.height_px]) - 1 - MARGIN_PX))
    return pixels if inside else None
