"""Pairs of pictures of the board as arrays: the rows of a fit, and the board's pose in one pair."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crosspih_common.config.board import BoardPattern
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.calibration.boards import Corners
from services.vision.stereo import Camera

Pair = tuple[Corners, Corners]
# how far a corner of a good board is from its place in the pattern (print, bow); the same in every picture
PRINTED_SD_M = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Corners of all pairs, one per row: the pair (m,), the camera (m,) 0 or 1, the place on the board (m, 3), m, and
    pixels (m, 2)."""

    pair: NDArray[np.int64]
    side: NDArray[np.int64]
    points_m: Array
    pixels: Array

    @classmethod
    def of(cls, pairs: list[Pair], pattern: BoardPattern) -> Rows:
        """From the corners found; a picture without corners adds no rows."""
        corners_m = pattern.corners_m()
        pair, side, points, pixels = [], [], [], []
        for index, both in enumerate(pairs):
            for camera, corners in enumerate(both):
                pair += [index] * len(corners)
                side += [camera] * len(corners)
                points.append(corners_m[corners.ids])
                pixels.append(corners.pixels)
        return cls(
            np.asarray(pair, dtype=np.int64), np.asarray(side, dtype=np.int64), np.concatenate(points),
            np.concatenate(pixels),
        )  # fmt: skip

    def of_pairs(self, chosen: NDArray[np.int64]) -> Rows:
        """The rows of the chosen pairs, renumbered from 0 in that order."""
        number = np.full(int(self.pair.max()) + 1, -1)
        number[chosen] = np.arange(len(chosen))
        kept = number[self.pair] >= 0
        return Rows(number[self.pair[kept]], self.side[kept], self.points_m[kept], self.pixels[kept])

    def where(self, kept: NDArray[np.bool_]) -> Rows:
        """The rows where `kept` (m,) is true."""
        return Rows(self.pair[kept], self.side[kept], self.points_m[kept], self.pixels[kept])

    @property
    def groups(self) -> NDArray[np.int64]:
        """(2 m,): the pair of each residual, u and v in turn."""
        return np.repeat(self.pair, 2)

    def with_a_corner_moved(self) -> list[Rows]:
        """For each corner and each of x, y, z: the same pictures of a board on which that corner is moved by
        `PRINTED_SD_M`."""
        found = []
        for corner in np.unique(self.points_m, axis=0):
            here = np.all(self.points_m == corner, axis=1)
            for away in PRINTED_SD_M * np.eye(3):
                points = np.where(here[:, None], self.points_m + away, self.points_m)
                found.append(Rows(self.pair, self.side, points, self.pixels))
        return found

    def in_left_m(self, poses: Array) -> Array:
        """(m, 3): the corners in the left camera's frame, m, of boards at poses (n, 6): rotation vector and
        translation."""
        rotations = Rotation.from_rotvec(poses[:, :3]).as_matrix()
        turned = np.einsum("mij,mj->mi", rotations[self.pair], self.points_m)
        return np.asarray(turned + poses[self.pair, 3:], dtype=float)

    def off_px(self, in_left_m: Array, cameras: tuple[Camera, Camera], pose_left_right: Pose) -> Array:
        """(2 m,), px: the measured pixels minus the projections of corners (m, 3) in the left camera's frame, m."""
        off = np.empty((len(self.pair), 2))
        left = self.side == 0
        off[left] = self.pixels[left] - cameras[0].project(in_left_m[left])
        back = pose_left_right.inverse()
        off[~left] = self.pixels[~left] - cameras[1].project(back.apply(in_left_m[~left]))
        return off.ravel()


def vector_of(pose: Pose) -> Array:
    """(6,): rotation vector, rad, and translation, m."""
    return np.concatenate([pose.rotvec_rad(), pose.translation_m])


def pose_of(vector: Array) -> Pose:
    """The inverse of `vector_of`."""
    return Pose.from_rotvec(vector[:3], vector[3:])


def board_pose(corners: Corners, pattern: BoardPattern, camera: Camera) -> Pose | None:
    """`pose_camera_board` from one picture alone; None where it shows too little."""
    if not len(corners):
        return None
    slopes = camera.slopes(corners.pixels)
    sound = np.all(np.isfinite(slopes), axis=1)
    if int(sound.sum()) < 6:
        return None
    points = pattern.corners_m()[corners.ids][sound]
    ok, turn, shift = cv2.solvePnP(points, slopes[sound], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    if not ok:
        return None
    turn, shift = cv2.solvePnPRefineLM(points, slopes[sound], np.eye(3), None, turn, shift)
    pose = Pose.from_rotvec(np.asarray(turn).ravel(), np.asarray(shift).ravel())
    return pose if pose.translation_m[2] > 0.0 else None


def starts(pairs: list[Pair], pattern: BoardPattern, cameras: tuple[Camera, Camera], pose_left_right: Pose) -> Array:
    """(n, 6): the board in the left camera's frame, by the left picture, or by the right one if that shows more
    corners."""
    found = np.zeros((len(pairs), 6))
    for index, (left, right) in enumerate(pairs):
        by_left, by_right = board_pose(left, pattern, cameras[0]), board_pose(right, pattern, cameras[1])
        if by_right is not None and (by_left is None or len(right) > len(left)):
            by_left = pose_left_right @ by_right
        if by_left is None:
            raise ValueError(f"pair {index} shows no board")
        found[index] = vector_of(by_left)
    return found
