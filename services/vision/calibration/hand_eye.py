"""The pose of the cameras in the arm's base, by an arm that shows them a board (eye-to-hand calibration).

Park and Martin's closed form gives a start (OpenCV 5 has no calibrateHandEye any more); then the camera's pose and the
board's pose on the flange are fitted to all corners of both pictures at once, in pixels. The arm's own errors appear as
residuals, pose by pose. They are included in the intervals, which come from leaving poses out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.calibration.fitting import CalibrationRefused, GroupedFit, fit_groups, held_out_folds, moved_by
from crosspih_common.config.board import BoardPattern
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.calibration.pairs import Pair, Rows, pose_of, starts, vector_of
from services.vision.calibration.stereo import STEP_M, STEP_RAD, Rig, not_wild, posed
from services.vision.stereo import Camera

MIN_POSES, MIN_TURN_RAD, GOOD_TURN_RAD = 5, np.deg2rad(5.0), np.deg2rad(12.0)
STEPS = np.array([STEP_RAD] * 3 + [STEP_M] * 3)


@dataclass(frozen=True, slots=True, eq=False)
class HandEyeFit:
    """pose_base_camera (the left one) and pose_flange_board; the fit of both (12 unknowns: rotation vector and
    translation of a small change of the camera's pose in its own frame, then of the board's); and the errors at poses
    that were left out: mm and degrees between the measured and the predicted board, and px."""

    pose_base_camera: Pose
    pose_flange_board: Pose
    fit: GroupedFit
    residual_mm: Array
    residual_deg: Array
    held_out_mm: float
    held_out_deg: float
    held_out_px: float


def turning(poses_base_flange: list[Pose]) -> tuple[Array, Array]:
    """The flange's rotation about each of three axes (3,), rad rms, smallest first, and the axes (3, 3), rows, in the
    flange's frame. The last axis is the one with the largest rotation."""
    mean = Rotation.from_matrix(np.array([pose.rotation for pose in poses_base_flange])).mean()
    turns = np.array([(mean.inv() * Rotation.from_matrix(pose.rotation)).as_rotvec() for pose in poses_base_flange])
    sizes, axes = np.linalg.eigh(turns.T @ turns / len(turns))
    return np.sqrt(np.maximum(sizes, 0.0)), axes.T


def missing_turns(poses_base_flange: list[Pose]) -> list[str]:
    """Advice on what to show next: an axis about which the flange was hardly turned."""
    if len(poses_base_flange) < 2:
        return [f"{len(poses_base_flange)} poses; take 12 or more"]
    said = [] if len(poses_base_flange) >= 10 else [f"{len(poses_base_flange)} poses; take 12 or more"]
    sizes, axes = turning(poses_base_flange)
    for size, axis in zip(sizes, axes, strict=True):
        if size < GOOD_TURN_RAD:
            shown = ", ".join(f"{value:+.2f}" for value in axis)
            said.append(
                f"the flange was turned by {np.rad2deg(size):.1f} degrees rms about ({shown}) of its own frame; turn "
                "it about that axis as well, by 20 degrees and more both ways"
            )
    return said


def _refuse_degenerate(poses_base_flange: list[Pose]) -> None:
    if len(poses_base_flange) < MIN_POSES:
        raise CalibrationRefused(
            f"{len(poses_base_flange)} poses show the board, want {MIN_POSES} or more (12 are good)"
        )
    sizes, axes = turning(poses_base_flange)
    if sizes[1] < MIN_TURN_RAD:
        only = ", ".join(f"{value:+.2f}" for value in axes[2])
        other = ", ".join(f"{value:+.2f}" for value in axes[1])
        raise CalibrationRefused(
            f"the flange was turned about one axis only, ({only}) of its own frame: where the cameras stand along it "
            f"stays open; turn it about ({other}) too, by 20 degrees and more both ways"
        )


def park_martin(flanges: list[Pose], boards: list[Pose]) -> tuple[Pose, Pose]:
    """The left camera in the base and the board on the flange, from `pose_base_flange` and `pose_camera_board`.

    For two poses i and j, A X = X B with X the camera in the base, A = flange_i flange_j^-1 and B = board_i board_j^-1:
    the rotation is that which takes the rotation vectors of all B to those of all A, then the places are linear (Park
    and Martin 1994, IEEE Trans. Robotics and Automation 10, 717; here by all pairs and by Kabsch's rotation).
    """
    pairs = [(i, j) for i in range(len(flanges)) for j in range(i)]
    moved = [flanges[i] @ flanges[j].inverse() for i, j in pairs]
    seen = [boards[i] @ boards[j].inverse() for i, j in pairs]
    by_arm, by_camera = (np.array([pose.rotvec_rad() for pose in poses]) for poses in (moved, seen))
    left, _, right = np.linalg.svd(by_arm.T @ by_camera)
    turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    design = np.concatenate([pose.rotation - np.eye(3) for pose in moved])
    wanted = np.concatenate([
        turn @ b.translation_m - a.translation_m for a, b in zip(moved, seen, strict=True)
    ])  # fmt: skip
    camera = Pose(turn, np.linalg.lstsq(design, wanted, rcond=None)[0])
    on_flange = [flange.inverse() @ camera @ board for flange, board in zip(flanges, boards, strict=True)]
    mean = Rotation.from_matrix(np.array([pose.rotation for pose in on_flange])).mean().as_matrix()
    return camera, Pose(mean, np.median([pose.translation_m for pose in on_flange], axis=0))


def _fitted(
    rows: Rows, flanges: list[Pose], cameras: tuple[Camera, Camera], pose_left_right: Pose, first: tuple[Pose, Pose]
) -> tuple[Pose, Pose, GroupedFit]:
    camera, board = first

    def both(shared: Array) -> tuple[Pose, Pose]:
        return camera @ pose_of(shared[:6]), board @ pose_of(shared[6:])

    def residual(shared: Array, _: Array) -> Array:
        to_camera, on_flange = both(shared)
        to_camera = to_camera.inverse()
        poses = [to_camera @ flange @ on_flange for flange in flanges]
        rotations, places = np.array([pose.rotation for pose in poses]), np.array([p.translation_m for p in poses])
        seen = np.einsum("mij,mj->mi", rotations[rows.pair], rows.points_m) + places[rows.pair]
        seen[:, 2] = np.maximum(seen[:, 2], 1e-3)
        return rows.off_px(seen, cameras, pose_left_right)

    own = np.zeros((len(flanges), 0))
    fit = fit_groups(residual, np.zeros(12), own, rows.groups, np.concatenate([STEPS, STEPS]), np.zeros(0))
    return *both(fit.shared), fit


@dataclass(frozen=True, slots=True, eq=False)
class CameraDoubt:
    """Both cameras as `crosspih calibrate stereo` found them: the rig's unknowns (p,) and their covariance (p, p)."""

    rig: Rig
    shared: Array
    covariance: Array


def _by_cameras(rows: Rows, flanges: list[Pose], camera: Pose, board: Pose, doubt: CameraDoubt) -> Array:
    """(12, 12): what the cameras' covariance adds to that of the two poses, to first order."""
    rig = doubt.rig

    def off(shared: Array, rigged: Array) -> Array:
        to_camera, on_flange = (camera @ pose_of(shared[:6])).inverse(), board @ pose_of(shared[6:])
        poses = np.array([vector_of(to_camera @ flange @ on_flange) for flange in flanges])
        return rows.off_px(rows.in_left_m(poses), rig.cameras(rigged), rig.right(rigged))

    def by(which: int, steps: Array) -> Array:
        start = [np.zeros(12), doubt.shared]
        columns = []
        for size, step in zip(steps, np.diag(steps), strict=True):
            ahead, behind = list(start), list(start)
            ahead[which], behind[which] = start[which] + step, start[which] - step
            columns.append((off(*ahead) - off(*behind)) / (2.0 * size))
        return np.stack(columns, axis=1)

    moved = -np.linalg.lstsq(by(0, np.concatenate([STEPS, STEPS])), by(1, rig.steps()), rcond=None)[0]
    return np.asarray(moved @ doubt.covariance @ moved.T, dtype=float)


def _by_board(
    rows: Rows, flanges: list[Pose], camera: Pose, board: Pose, cameras: tuple[Camera, Camera], pose_left_right: Pose,
    fit: GroupedFit,
) -> Array:  # fmt: skip
    """(12, 12): the covariance added by a board that deviates from its pattern."""

    def off(of: Rows, shared: Array) -> Array:
        to_camera, on_flange = (camera @ pose_of(shared[:6])).inverse(), board @ pose_of(shared[6:])
        poses = np.array([vector_of(to_camera @ flange @ on_flange) for flange in flanges])
        return of.off_px(of.in_left_m(poses), cameras, pose_left_right)

    here = replace(fit, shared=np.zeros(12))  # for small changes of both poses
    changes = np.stack([off(moved, here.shared) for moved in rows.with_a_corner_moved()], axis=1)
    steps = np.concatenate([STEPS, STEPS])
    moved = moved_by(changes - off(rows, here.shared)[:, None], lambda shared, _: off(rows, shared), here, rows.groups,
                     steps, np.zeros(0))  # fmt: skip
    return np.asarray(moved @ moved.T, dtype=float)


def calibrate_hand_eye(
    pairs: list[Pair], flanges: list[Pose], pattern: BoardPattern, cameras: tuple[Camera, Camera],
    pose_left_right: Pose, folds: int = 5, doubt: CameraDoubt | None = None,
) -> HandEyeFit:  # fmt: skip
    """The left camera in the base, from pairs and the `pose_base_flange` of each.

    `doubt`: the uncertainty of the cameras, which is included in the intervals.
    Raises CalibrationRefused, which names the poses that are missing.
    """
    kept = [index for index, pair in enumerate(pairs) if len(pair[0]) + len(pair[1])]
    pairs, flanges = [pairs[index] for index in kept], [flanges[index] for index in kept]
    _refuse_degenerate(flanges)
    rows = Rows.of(pairs, pattern)
    alone = posed(rows, cameras, pose_left_right, starts(pairs, pattern, cameras, pose_left_right))
    rows = rows.where(not_wild(alone))
    seen = posed(rows, cameras, pose_left_right, alone.own).own
    boards = [pose_of(vector) for vector in seen]
    camera, board, fit = _fitted(rows, flanges, cameras, pose_left_right, park_martin(flanges, boards))
    fit = replace(
        fit, covariance=fit.covariance + _by_board(rows, flanges, camera, board, cameras, pose_left_right, fit)
    )
    if doubt is not None:
        fit = replace(fit, covariance=fit.covariance + _by_cameras(rows, flanges, camera, board, doubt))
    middle = np.append(pattern.size_m / 2.0, 0.0)
    apart = _apart(camera, board, flanges, boards, middle)
    squares, count, away = 0.0, 0, []
    for left_out in held_out_folds(len(pairs), folds):
        rest = np.setdiff1d(np.arange(len(pairs)), left_out)
        held_camera, held_board, _ = _fitted(
            rows.of_pairs(rest), [flanges[i] for i in rest], cameras, pose_left_right, (camera, board)
        )
        out = rows.of_pairs(left_out)
        predicted = np.array([
            vector_of(held_camera.inverse() @ flanges[i] @ held_board) for i in left_out
        ])  # fmt: skip
        off = out.off_px(out.in_left_m(predicted), cameras, pose_left_right)
        squares, count = squares + float(off @ off), count + len(off)
        away.append(
            _apart(held_camera, held_board, [flanges[i] for i in left_out], [boards[i] for i in left_out], middle)
        )
    out_mm, out_deg = np.concatenate([one[0] for one in away]), np.concatenate([one[1] for one in away])
    return HandEyeFit(
        camera, board, fit, *apart, float(np.sqrt(np.mean(out_mm**2))), float(np.sqrt(np.mean(out_deg**2))),
        float(np.sqrt(squares / count)),
    )  # fmt: skip


def _apart(camera: Pose, board: Pose, flanges: list[Pose], boards: list[Pose], middle: Array) -> tuple[Array, Array]:
    """The measured against the predicted pose of the board: (n,) mm at its middle and (n,) degrees."""
    expected = [camera.inverse() @ flange @ board for flange in flanges]
    away = [
        1e3 * np.linalg.norm(one.apply(middle) - other.apply(middle))
        for one, other in zip(expected, boards, strict=True)
    ]
    turned = [np.rad2deg(one.angle_to_rad(other)) for one, other in zip(expected, boards, strict=True)]
    return np.array(away), np.array(turned)
