"""Poses: a rotation and a translation, named `pose_a_b` for "frame b seen in frame a".

A `Pose` named ``pose_base_hole`` maps coordinates in the hole frame to coordinates in the base frame, so that
``pose_base_hole = pose_base_peg @ pose_peg_hole``: neighbouring names cancel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crosspih_common.geometry.rotation import rotation_of, rotations

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A rigid transform. `rotation` is (3, 3), proper orthonormal; `translation_m` is (3,), metres.

    >>> pose = Pose.from_rotvec([0.0, 0.0, np.pi / 2], [1.0, 0.0, 0.0])
    >>> np.round(pose.apply([1.0, 0.0, 0.0]), 6).tolist()
    [1.0, 1.0, 0.0]
    """

    rotation: Array
    translation_m: Array

    def __post_init__(self) -> None:
        rotation = np.asarray(self.rotation, dtype=float)
        translation = np.asarray(self.translation_m, dtype=float)
        if rotation.shape != (3, 3) or translation.shape != (3,):
            raise ValueError(
                f"Pose wants rotation (3, 3) and translation (3,), got {rotation.shape} and {translation.shape}"
            )
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation_m", translation)

    @classmethod
    def identity(cls) -> Pose:
        """The pose of a frame in itself."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Pose:
        """From a (4, 4) homogeneous matrix; its rotation is made orthonormal (printed matrices are rounded)."""
        full = np.asarray(matrix, dtype=float)
        return cls(rotations().from_matrix(full[:3, :3]).as_matrix(), full[:3, 3].copy())

    @classmethod
    def from_rotvec(cls, rotvec_rad: ArrayLike, translation_m: ArrayLike) -> Pose:
        """From a rotation vector (3,), rad, and a translation (3,), m."""
        return cls(rotations().from_rotvec(np.asarray(rotvec_rad, float)).as_matrix(), np.asarray(translation_m, float))

    @classmethod
    def from_quaternion(cls, quaternion_xyzw: ArrayLike, translation_m: ArrayLike) -> Pose:
        """From a quaternion (x, y, z, w) and a translation (3,), m."""
        return cls(
            rotations().from_quat(np.asarray(quaternion_xyzw, float)).as_matrix(), np.asarray(translation_m, float)
        )

    @classmethod
    def from_translation(cls, translation_m: Sequence[float] | Array) -> Pose:
        """A pure translation (3,), m."""
        return cls(np.eye(3), np.asarray(translation_m, float))

    def matrix(self) -> Array:
        """The (4, 4) homogeneous matrix."""
        full = np.eye(4)
        full[:3, :3] = self.rotation
        full[:3, 3] = self.translation_m
        return full

    def rotvec_rad(self) -> Array:
        """The rotation vector (3,), rad."""
        return np.asarray(rotation_of(self.rotation).as_rotvec(), dtype=float)

    def quaternion_xyzw(self) -> Array:
        """The quaternion (x, y, z, w), w >= 0."""
        return np.asarray(rotation_of(self.rotation).as_quat(canonical=True), dtype=float)

    def inverse(self) -> Pose:
        """`pose_b_a` of a `pose_a_b`."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation_m)

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation_m + self.translation_m)

    def apply(self, points_m: ArrayLike) -> Array:
        """Points (..., 3) in frame b to frame a, m."""
        return np.asarray(points_m, float) @ self.rotation.T + self.translation_m

    def rotate(self, vectors: ArrayLike) -> Array:
        """Free vectors (..., 3) in frame b to frame a."""
        return np.asarray(vectors, float) @ self.rotation.T

    def angle_to_rad(self, other: Pose) -> float:
        """The angle between the two rotations, rad."""
        return float(rotation_of(self.rotation.T @ other.rotation).magnitude())

    def distance_to_m(self, other: Pose) -> float:
        """The distance between the two origins, m."""
        return float(np.linalg.norm(self.translation_m - other.translation_m))


def rotation_from_error_angles(angles_rad: ArrayLike) -> Array:
    """`rotation_peg_hole` (..., 3, 3) of the paper's error angles (..., 3) = (alpha, beta, gamma), rad.

    alpha turns about z, beta about y, gamma about x, in the order R = Rz(alpha) Rx(gamma) Ry(beta): the only order
    that fits the paper's Tables 6 and 7.
    """
    angles = np.asarray(angles_rad, float)
    flat = angles.reshape(-1, 3)
    matrix = rotations().from_euler("ZXY", flat[:, [0, 2, 1]]).as_matrix()
    return np.asarray(matrix.reshape(*angles.shape[:-1], 3, 3), dtype=float)


def rotation_to_error_angles(rotation: ArrayLike) -> Array:
    """(alpha, beta, gamma) (..., 3), rad, of a `rotation_peg_hole` (..., 3, 3): the inverse of the above."""
    matrix = np.asarray(rotation, float)
    euler = rotations().from_matrix(matrix.reshape(-1, 3, 3)).as_euler("ZXY")
    return np.asarray(euler[:, [0, 2, 1]].reshape(*matrix.shape[:-2], 3), dtype=float)
