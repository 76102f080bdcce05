"""Wrenches: force and moment as one (6,) array (Fx, Fy, Fz, Mx, My, Mz), N and Nm, about a frame's origin."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array, Pose


def skew(vector: ArrayLike) -> Array:
    """The (3, 3) matrix S with S @ w = vector x w."""
    x, y, z = np.asarray(vector, float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def adjoint_wrench(pose_a_b: Pose) -> Array:
    """The (6, 6) matrix that takes a wrench in frame b to the same wrench in frame a.

    F_a = R F_b, M_a = R M_b + t x (R F_b) (Murray, Li, Sastry, "A Mathematical Introduction to Robotic Manipulation",
    section 5.1, in force-first order).
    """
    rotation = pose_a_b.rotation
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = rotation
    matrix[3:, 3:] = rotation
    matrix[3:, :3] = skew(pose_a_b.translation_m) @ rotation
    return matrix


def transform_wrench(pose_a_b: Pose, wrench_b: ArrayLike) -> Array:
    """Wrenches (..., 6) in frame b to frame a, N and Nm."""
    return np.asarray(wrench_b, float) @ adjoint_wrench(pose_a_b).T


def wrench_of_force_at_point(force_n: ArrayLike, point_m: ArrayLike) -> Array:
    """The wrench (..., 6) about the origin of a force (..., 3), N, at a point (..., 3), m (the paper's Eq. 24)."""
    force = np.asarray(force_n, float)
    return np.concatenate([force, np.cross(np.asarray(point_m, float), force)], axis=-1)
