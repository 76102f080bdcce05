"""Calibrates two cameras from pairs of pictures of a board: each lens, and the pose of the right camera.

OpenCV's calibrateCamera gives a start; then all pairs of both cameras are fitted at once, with the board's pose in each
pair as an unknown. Pairs that are left out of the fit decide how many distortion coefficients a lens gets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.calibration.fitting import CalibrationRefused, GroupedFit, fit_groups, held_out_folds, moved_by
from crosspih_common.config.board import BoardPattern
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraModel, DistortionModel
from services.vision.calibration.coverage import tilt
from services.vision.calibration.pairs import Pair, Rows, pose_of, starts, vector_of
from services.vision.stereo import Camera

MODELS: dict[str, tuple[int, ...]] = {
    "none": (), "k1": (0,), "k1 k2": (0, 1), "k1 k2 p1 p2": (0, 1, 2, 3), "k1 k2 p1 p2 k3": (0, 1, 2, 3, 4),
    "k1 to k6, p1 p2": (0, 1, 2, 3, 4, 5, 6, 7),
}  # fmt: skip
NUMBERS = 8
GIVEN_UP = 2  # stop after this many larger models in a row that are not better
BETTER = 0.03  # a larger model must reduce the held-out error by this share
MIN_PAIRS, MIN_TILT_RAD = 5, np.deg2rad(10.0)
WILD_SD, WILD_PX = 5.0, 0.5
MEDIAN_OF_TWO = 1.1774  # median length of a vector of two normal numbers, in sd
STEP_PX, STEP_BEND, STEP_RAD, STEP_M = 1e-3, 1e-6, 1e-6, 1e-7
Sizes = tuple[tuple[int, int], tuple[int, int]]


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """Both cameras as unknowns (p,): fx, fy, cx, cy and the distortion coefficients of each, then the right one's
    pose."""

    sizes: Sizes
    numbers: tuple[int, ...]

    @property
    def width(self) -> int:
        """The number of unknowns of one camera."""
        return 4 + len(self.numbers)

    def names(self) -> list[str]:
        """The names of the unknowns."""
        each = ["fx", "fy", "cx", "cy", *(("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")[n] for n in self.numbers)]
        return [*(f"left {name}" for name in each), *(f"right {name}" for name in each),
                "right rx", "right ry", "right rz", "right x", "right y", "right z"]  # fmt: skip

    def steps(self) -> Array:
        """(p,): step sizes for numerical derivatives."""
        each = [STEP_PX] * 4 + [STEP_BEND] * len(self.numbers)
        return np.array([*each, *each, *[STEP_RAD] * 3, *[STEP_M] * 3])

    def cameras(self, shared: Array) -> tuple[Camera, Camera]:
        """Both cameras, from the unknowns (p,)."""
        left, right = (
            Camera.of(self.model(shared[side * self.width : (side + 1) * self.width], side)) for side in (0, 1)
        )
        return left, right

    def model(self, own: Array, side: int) -> CameraModel:
        """One camera in the form of the camera message."""
        distortion = np.zeros(NUMBERS)
        distortion[list(self.numbers)] = own[4:]
        count = 0 if not self.numbers else max(4, max(self.numbers) + 1)
        width, height = self.sizes[side]
        fx, fy, cx, cy = (float(value) for value in own[:4])
        return CameraModel(
            width_px=width, height_px=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy,
            distortion_model=DistortionModel.PLUMB_BOB if count else DistortionModel.NONE,
            distortion=tuple(float(value) for value in distortion[:count]),
        )  # fmt: skip

    def right(self, shared: Array) -> Pose:
        """The right camera in the left one's frame."""
        return pose_of(shared[2 * self.width :])

    def from_other(self, other: Rig, shared: Array) -> Array:
        """The unknowns of this rig, from those of a rig with another number of distortion coefficients."""
        found = []
        for side in (0, 1):
            own = shared[side * other.width : (side + 1) * other.width]
            known = dict(zip(other.numbers, own[4:], strict=True))
            found += [own[:4], [known.get(number, 0.0) for number in self.numbers]]
        return np.concatenate([*found, shared[2 * other.width :]])


@dataclass(frozen=True, slots=True, eq=False)
class StereoFit:
    """The rig and its fit, the size of the distortion model with the held-out error of each size (px), and the rows
    that were used and those that were removed as outliers."""

    rig: Rig
    fit: GroupedFit
    rows: Rows
    model: str
    held_out_px: dict[str, float]
    wild: int

    def board_poses(self) -> list[Pose]:
        """The board in the left camera's frame, of each pair."""
        return [pose_of(vector) for vector in self.fit.own]


def _start(pairs: list[Pair], pattern: BoardPattern, sizes: Sizes) -> tuple[Rig, Array, Array]:
    """By OpenCV, with k1 and k2, each camera alone; the right one's pose by the median over the pairs."""
    corners_m = pattern.corners_m().astype(np.float32)
    rig = Rig(sizes, MODELS["k1 k2"])
    each, poses = [], []
    fixed = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    for side in (0, 1):
        seen = [(index, pair[side]) for index, pair in enumerate(pairs) if len(pair[side])]
        if len(seen) < MIN_PAIRS:
            raise CalibrationRefused(
                f"the {('left', 'right')[side]} camera saw the board in {len(seen)} pictures, want {MIN_PAIRS} or "
                "more: show the whole board, sharp and lit, and check --board against the print"
            )
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
            [corners_m[corners.ids] for _, corners in seen],
            [corners.pixels.astype(np.float32).reshape(-1, 1, 2) for _, corners in seen],
            sizes[side], None, None, flags=fixed,
        )  # fmt: skip
        k1, k2 = np.asarray(distortion).ravel()[:2]
        each.append([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], k1, k2])
        poses.append({
            index: Pose.from_rotvec(np.asarray(turn).ravel(), np.asarray(shift).ravel())
            for (index, _), turn, shift in zip(seen, turns, shifts, strict=True)
        })  # fmt: skip
    both = sorted(set(poses[0]) & set(poses[1]))
    if len(both) < MIN_PAIRS:
        raise CalibrationRefused(
            f"both cameras saw the board in {len(both)} pairs only, want {MIN_PAIRS} or more: show it where their "
            "pictures overlap"
        )
    beside = np.array([vector_of(poses[0][index] @ poses[1][index].inverse()) for index in both])
    shared = np.concatenate([*each, np.median(beside, axis=0)])
    return rig, shared, starts(pairs, pattern, rig.cameras(shared), rig.right(shared))


def _fitted(rig: Rig, rows: Rows, shared: Array, own: Array) -> GroupedFit:
    def residual(unknowns: Array, poses: Array) -> Array:
        return rows.off_px(rows.in_left_m(poses), rig.cameras(unknowns), rig.right(unknowns))

    own_steps = np.array([STEP_RAD] * 3 + [STEP_M] * 3)
    return fit_groups(residual, shared, own, rows.groups, rig.steps(), own_steps)


def _by_board(rig: Rig, rows: Rows, fit: GroupedFit) -> Array:
    """(p, p): the covariance added by a board that deviates from its pattern. All pictures show the same board."""
    cameras, right = rig.cameras(fit.shared), rig.right(fit.shared)
    changes = [
        board.off_px(board.in_left_m(fit.own), cameras, right) - fit.residual for board in rows.with_a_corner_moved()
    ]

    def residual(unknowns: Array, poses: Array) -> Array:
        return rows.off_px(rows.in_left_m(poses), rig.cameras(unknowns), rig.right(unknowns))

    own_steps = np.array([STEP_RAD] * 3 + [STEP_M] * 3)
    moved = moved_by(np.stack(changes, axis=1), residual, fit, rows.groups, rig.steps(), own_steps)
    return np.asarray(moved @ moved.T, dtype=float)


def _left_out_px(rig: Rig, rows: Rows, shared: Array, own: Array, folds: int) -> float:
    """The rms over held-out pairs, px: only their board's pose is fitted, to both pictures."""
    squares, count = 0.0, 0
    everything = np.arange(len(own))
    for left_out in held_out_folds(len(own), folds):
        kept = np.setdiff1d(everything, left_out)
        fit = _fitted(rig, rows.of_pairs(kept), shared, own[kept])
        off = posed(rows.of_pairs(left_out), rig.cameras(fit.shared), rig.right(fit.shared), own[left_out]).residual
        squares, count = squares + float(off @ off), count + len(off)
    return float(np.sqrt(squares / count))


def posed(rows: Rows, cameras: tuple[Camera, Camera], pose_left_right: Pose, own: Array) -> GroupedFit:
    """Fit the board's pose in each pair, with known cameras."""

    def residual(_: Array, poses: Array) -> Array:
        return rows.off_px(rows.in_left_m(poses), cameras, pose_left_right)

    own_steps = np.array([STEP_RAD] * 3 + [STEP_M] * 3)
    return fit_groups(residual, np.zeros(0), own, rows.groups, np.zeros(0), own_steps)


def not_wild(fit: GroupedFit) -> NDArray[np.bool_]:
    """(m,): true for the corners of a fit that are no outliers; the scale is the typical residual."""
    off = np.linalg.norm(fit.residual.reshape(-1, 2), axis=1)
    return np.asarray(off < max(WILD_SD * float(np.median(off)) / MEDIAN_OF_TWO, WILD_PX))


def calibrate_stereo(
    pairs: list[Pair], pattern: BoardPattern, sizes: Sizes, model: str | None = None, folds: int = 4
) -> StereoFit:
    """Both cameras, from pairs that show the board in at least one picture each.

    `model` is one of `MODELS`; None: chosen by the held-out error. Raises CalibrationRefused, which names the missing
    pictures: too few, or all parallel to the image planes, which cannot separate the focal length from the distance.
    """
    pairs = [pair for pair in pairs if len(pair[0]) or len(pair[1])]
    if len(pairs) < MIN_PAIRS:
        raise CalibrationRefused(
            f"{len(pairs)} pairs show the board, want {MIN_PAIRS} or more (12 are good): show the whole board, sharp "
            "and lit, and check --board against the print"
        )
    rig, shared, own = _start(pairs, pattern, sizes)
    tilts = np.array([tilt(pose_of(vector)) for vector in own])
    if float(np.max(np.ptp(tilts, axis=0))) < 2.0 * MIN_TILT_RAD:
        raise CalibrationRefused(
            "in all pictures the board is tilted nearly the same: a focal length cannot be told from a distance; tilt "
            "it by 20 to 40 degrees, to the left, right, up and down"
        )
    rows = Rows.of(pairs, pattern)
    fit = _fitted(rig, rows, shared, own)
    sound = not_wild(fit)
    rows = rows.where(sound)
    left_out: dict[str, float] = {}
    best, in_vain = "", 0
    for name, numbers in MODELS.items():
        if model is not None and name != model:
            continue
        sized = Rig(sizes, numbers)
        try:
            left_out[name] = _left_out_px(sized, rows, sized.from_other(rig, fit.shared), fit.own, folds)
        except CalibrationRefused:
            if best:
                continue  # more coefficients than these pairs can determine
            raise
        if not best or left_out[name] < (1.0 - BETTER) * left_out[best]:
            best, in_vain = name, 0
        else:
            in_vain += 1
        if in_vain == GIVEN_UP:
            break
    chosen = Rig(sizes, MODELS[best])
    final = _fitted(chosen, rows, chosen.from_other(rig, fit.shared), fit.own)
    final = replace(final, covariance=final.covariance + _by_board(chosen, rows, final))
    return StereoFit(chosen, final, rows, best, left_out, int(np.sum(~sound)))
