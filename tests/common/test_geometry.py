"""Poses and wrenches: known answers and the laws they must keep."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from crosspih_common.geometry import (
    Pose,
    rotation_from_error_angles,
    rotation_to_error_angles,
    transform_wrench,
    wrench_of_force_at_point,
)

vectors = arrays(float, 3, elements=st.floats(-2.0, 2.0))
wrenches = arrays(float, 6, elements=st.floats(-50.0, 50.0))
poses = st.builds(Pose.from_rotvec, vectors, vectors)


@given(poses, poses, vectors)
def test_composition_is_application(a: Pose, b: Pose, point: np.ndarray) -> None:
    assert np.allclose((a @ b).apply(point), a.apply(b.apply(point)), atol=1e-12)


@given(poses)
def test_inverse_undoes(pose: Pose) -> None:
    identity = pose @ pose.inverse()
    assert np.allclose(identity.matrix(), np.eye(4), atol=1e-12)


@given(poses)
def test_quaternion_round_trip(pose: Pose) -> None:
    again = Pose.from_quaternion(pose.quaternion_xyzw(), pose.translation_m)
    assert np.allclose(again.rotation, pose.rotation, atol=1e-12)


@given(poses, vectors, vectors)
def test_power_does_not_depend_on_the_frame(pose_a_b: Pose, force: np.ndarray, point: np.ndarray) -> None:
    """A force at a point has the same wrench whether it is moved first or its wrench is transformed."""
    direct = wrench_of_force_at_point(pose_a_b.rotate(force), pose_a_b.apply(point))
    assert np.allclose(transform_wrench(pose_a_b, wrench_of_force_at_point(force, point)), direct, atol=1e-9)


@given(poses, wrenches)
def test_pitch_is_invariant(pose: Pose, wrench: np.ndarray) -> None:
    moved = transform_wrench(pose, wrench)
    assert np.isclose(moved[:3] @ moved[3:], wrench[:3] @ wrench[3:], atol=1e-7)


def test_error_angles_turn_about_z_then_x_then_y() -> None:
    """R = Rz(alpha) Rx(gamma) Ry(beta), the order of Tables 6 and 7."""
    alpha, beta, gamma = 0.1, 0.05, 0.04
    cz, sz, cy, sy, cx, sx = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta), np.cos(gamma), np.sin(gamma)
    rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    assert np.allclose(rotation_from_error_angles([alpha, beta, gamma]), rz @ rx @ ry, atol=1e-14)


@given(arrays(float, (4, 3), elements=st.floats(-1.0, 1.0)))
def test_error_angles_round_trip(angles: np.ndarray) -> None:
    assert np.allclose(rotation_to_error_angles(rotation_from_error_angles(angles)), angles, atol=1e-9)


def test_paper_t1_is_the_product_of_its_parts() -> None:
    """Eqs. 6 to 9: the position of T1 from the camera's pose and the hole in the left camera."""
    pose_base_camera = Pose.from_matrix(
        np.array([[0, 0, 1, 0.1310], [-1, 0, 0, -0.2406], [0, -1, 0, 0.2225], [0, 0, 0, 1]])
    )
    pose_camera_hole = Pose.from_matrix(
        np.array([[0, 1, 0, 0.0507], [-1, 0, 0, 0.0085], [0, 0, 1, 0.3002], [0, 0, 0, 1]])
    )
    assert np.allclose((pose_base_camera @ pose_camera_hole).translation_m, [0.4312, -0.2913, 0.2140], atol=1e-12)
