"""Rotations as nine plain floats, row by row: for loops that rotate one vector or one frame in every cycle, where a
call of NumPy takes longer than the arithmetic."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array

Rows = tuple[float, float, float, float, float, float, float, float, float]


def rows_of(rotation: Array) -> Rows:
    """The nine floats, row by row, of a matrix (3, 3)."""
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rotation.tolist()
    return r00, r01, r02, r10, r11, r12, r20, r21, r22


def matrix_of(rows: Rows) -> Array:
    """The matrix (3, 3) of nine floats, row by row."""
    return np.array(rows).reshape(3, 3)


def turned(rows: Rows, x: float, y: float, z: float) -> Rows:
    """A rotation `rotation_base_b` after a small turn by a rotation vector (x, y, z), rad, of the base frame.

    Rodrigues' formula, R = I + a S + b S^2 with a = sin(t) / t and b = (1 - cos(t)) / t^2 by their series, which are
    exact to 1e-12 for turns up to 0.01 rad (Murray, Li, Sastry, "A Mathematical Introduction to Robotic Manipulation",
    section 2.2).
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rows
    xx, yy, zz = x * x, y * y, z * z
    squared = xx + yy + zz
    a = 1.0 - squared / 6.0
    b = 0.5 - squared / 24.0
    ax, ay, az = a * x, a * y, a * z
    bxy, bxz, byz = b * x * y, b * x * z, b * y * z
    t00, t01, t02 = 1.0 - b * (yy + zz), bxy - az, bxz + ay
    t10, t11, t12 = bxy + az, 1.0 - b * (xx + zz), byz - ax
    t20, t21, t22 = bxz - ay, byz + ax, 1.0 - b * (xx + yy)
    return (
        t00 * r00 + t01 * r10 + t02 * r20, t00 * r01 + t01 * r11 + t02 * r21, t00 * r02 + t01 * r12 + t02 * r22,
        t10 * r00 + t11 * r10 + t12 * r20, t10 * r01 + t11 * r11 + t12 * r21, t10 * r02 + t11 * r12 + t12 * r22,
        t20 * r00 + t21 * r10 + t22 * r20, t20 * r01 + t21 * r11 + t22 * r21, t20 * r02 + t21 * r12 + t22 * r22,
    )  # fmt: skip
