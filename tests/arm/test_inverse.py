"""Inverse kinematics: forward of inverse is the pose, all branches are found, and refusals say why."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.arm import ArmModel, xb4
from crosspih_common.arm.closed_form import ClosedForm
from crosspih_common.arm.inverse import BranchJump, Unreachable, inverse, nearest, track
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

ARM = xb4()
TOOL = Pose.from_translation([0.0, 0.0, 0.1463])
T1_POSITION_EQ7_ROLL = [[0, 0, 1, 0.4312], [0, -1, 0, -0.2913], [1, 0, 0, 0.2140], [0, 0, 0, 1]]
T2 = [
    [-0.0690, 0.0745, 0.9948, 0.4365],
    [-0.0594, -0.9957, 0.0704, -0.3139],
    [0.9959, -0.0542, 0.0731, 0.2042],
    [0, 0, 0, 1],
]
T1_JOINTS = (-0.9419, 1.0352, 0.3222, -0.9528, -1.4459, 0.1735)
T2_JOINTS = (-0.9854, 1.1671, 0.1205, -1.0553, -1.5037, 0.3006)

joint_vectors = st.tuples(
    *(
        st.floats(low, high, allow_nan=False)
        for low, high in zip(ARM.limits.lower_rad.tolist(), ARM.limits.upper_rad.tolist(), strict=True)
    )
).map(np.array)


def same_pose(a: Pose, b: Pose, within: float = 1e-10) -> bool:
    return bool(
        np.abs(a.rotation - b.rotation).max() < within and np.abs(a.translation_m - b.translation_m).max() < within
    )


@settings(max_examples=200, deadline=None, derandomize=True)
@given(joint_vectors)
def test_every_solution_gives_the_pose_and_lies_inside_the_limits(joints: Array) -> None:
    pose = ARM.pose_base_flange(joints)
    solutions = inverse(ARM, pose)
    assert solutions
    for solution in solutions:
        assert same_pose(ARM.pose_base_flange(solution), pose)
        assert ARM.limits.violations(solution) == []
    rows = [tuple(solution.tolist()) for solution in solutions]
    assert rows == sorted(rows)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(joint_vectors)
def test_nearest_to_the_joints_themselves_gives_the_pose_with_the_least_motion(joints: Array) -> None:
    pose = ARM.pose_base_flange(joints)
    found = nearest(ARM, pose, joints)
    assert same_pose(ARM.pose_base_flange(found), pose)
    assert np.linalg.norm(found - joints) <= min(np.linalg.norm(q - joints) for q in inverse(ARM, pose)) + 1e-12


@settings(max_examples=200, deadline=None, derandomize=True)
@given(joint_vectors, st.tuples(*[st.floats(-1.0, 1.0)] * 6), st.sampled_from([1e-9, 1e-4, 1e-2, 0.3, 3.0]))
def test_following_is_nearest_to_the_bit(joints: Array, offset: tuple[float, ...], size_rad: float) -> None:
    """By the one branch of the seed's where that is enough, by all eight where not: as far off and at the limits."""
    pose, seed, solver = ARM.pose_base_flange(joints), joints + size_rad * np.array(offset), ClosedForm(ARM)
    try:
        wanted = solver.nearest(pose, seed)
    except Unreachable as error:
        with pytest.raises(Unreachable, match=re.escape(str(error))):
            solver.follow(pose, seed)
    else:
        assert np.array_equal(solver.follow(pose, seed), wanted)


STRETCHED = np.array([0.2, 0.0, -np.arctan2(0.280, 0.025), 0.0, 0.5, 0.0])


@pytest.mark.parametrize("singular", [STRETCHED, np.array([0.2, 0.3, 0.1, 0.7, 0.0, -0.2])], ids=["elbow", "wrist"])
@pytest.mark.parametrize("size_rad", [1e-9, 1e-6, 1e-3, 0.1])
def test_following_beside_a_singularity_is_still_the_nearest(singular: Array, size_rad: float) -> None:
    """Where two branches meet, the other one may be the nearer."""
    solver, rng = ClosedForm(ARM), np.random.default_rng(3)
    for _ in range(30):
        joints = singular + size_rad * rng.normal(size=6)
        pose, seed = ARM.pose_base_flange(joints), joints + 3.0 * size_rad * rng.normal(size=6)
        assert np.array_equal(solver.follow(pose, seed), solver.nearest(pose, seed))


def test_random_joints_come_back_and_all_solutions_are_distinct() -> None:
    rng = np.random.default_rng(1)
    most = 0
    for _ in range(300):
        joints = rng.uniform(ARM.limits.lower_rad, ARM.limits.upper_rad)
        pose = ARM.pose_base_flange(joints)
        solutions = np.array(inverse(ARM, pose))
        most = max(most, len(solutions))
        assert np.abs(solutions - joints).max(axis=1).min() < 1e-9
        gaps = np.abs(solutions[:, None] - solutions[None, :]).max(axis=2) + np.eye(len(solutions))
        assert gaps.min() > 1e-6
    assert most >= 16  # eight branches, joint 6 twice each


def test_without_limits_there_are_eight_branches() -> None:
    wide = replace(ARM.limits, lower_rad=np.full(6, -np.pi), upper_rad=np.full(6, np.pi))
    arm = replace(ARM, limits=wide)
    assert len(inverse(arm, arm.pose_base_flange([0.3, 0.4, 0.2, 0.5, 0.7, -0.4]))) == 8


@pytest.mark.parametrize(("matrix", "joints"), [(T1_POSITION_EQ7_ROLL, T1_JOINTS), (T2, T2_JOINTS)], ids=["T1", "T2"])
def test_known_joints_of_the_paper_poses(matrix: list[list[float]], joints: tuple[float, ...]) -> None:
    flange = Pose.from_matrix(matrix) @ TOOL.inverse()
    assert nearest(ARM, flange, joints) == pytest.approx(joints, abs=1e-4)


def test_wrist_singularity_keeps_the_seed() -> None:
    joints = np.array([0.2, 0.3, 0.1, 0.7, 0.0, -0.2])
    found = nearest(ARM, ARM.pose_base_flange(joints), joints)
    assert found == pytest.approx(joints, abs=1e-9)
    straight = [q for q in inverse(ARM, ARM.pose_base_flange(joints)) if abs(q[4]) < 1e-6]
    assert straight
    assert all(q[3] == 0.0 for q in straight)


@pytest.mark.parametrize("bend", [1e-13, 1e-11, 1e-9, 1e-7, 1e-4])
def test_next_to_the_wrist_singularity_the_pose_is_still_exact(bend: float) -> None:
    joints = np.array([0.2, 0.3, 0.1, 0.7, bend, -0.2])
    pose = ARM.pose_base_flange(joints)
    for solution in [*inverse(ARM, pose), nearest(ARM, pose, joints)]:
        assert same_pose(ARM.pose_base_flange(solution), pose)


def test_stretched_arm_is_reached_and_a_little_more_is_not() -> None:
    stretched = np.array([0.0, 0.0, -np.arctan2(0.280, 0.025), 0.0, 0.5, 0.0])
    pose = ARM.pose_base_flange(stretched)
    wrist = ARM.link_poses(stretched)[4].translation_m
    shoulder = ARM.link_poses(stretched)[1].translation_m
    outward = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
    inside = Pose(pose.rotation, pose.translation_m - 1e-9 * outward)
    assert same_pose(ARM.pose_base_flange(nearest(ARM, inside, stretched)), inside)
    with pytest.raises(Unreachable, match=r"7\.0 mm beyond reach"):
        nearest(ARM, Pose(pose.rotation, pose.translation_m + 0.007 * outward), stretched)


def test_refusals_say_why() -> None:
    seed = np.zeros(6)
    far = Pose.from_translation([1.0, 0.0, 0.5])
    with pytest.raises(Unreachable, match="beyond reach"):
        inverse(ARM, far)
    beyond = ARM.pose_base_flange([0.0, 0.5, 0.95, 0.0, 0.4, 0.0])
    with pytest.raises(Unreachable, match=r"each of 8 branches; on the closest, joint 3 at 0\.9500 rad is outside"):
        nearest(ARM, beyond, seed)
    singular = ARM.pose_base_flange([0.0, 0.5, 0.95, 0.0, 0.0, 0.0])
    with pytest.raises(Unreachable, match="the wrist is singular here"):
        nearest(ARM, singular, seed)
    assert inverse(ARM, beyond) == []
    with pytest.raises(Unreachable, match="not finite"):
        nearest(ARM, Pose(np.eye(3), np.array([np.nan, 0.0, 0.0])), seed)
    with pytest.raises(Unreachable, match="proper rotation"):
        nearest(ARM, Pose(np.diag([1.0, 1.0, -1.0]), np.array([0.4, 0.0, 0.4])), seed)
    with pytest.raises(ValueError, match="seed_joints_rad"):
        nearest(ARM, ARM.pose_base_flange(seed), [0.0] * 5)


def test_another_structure_is_refused() -> None:
    dh = ARM.dh.copy()
    dh[4, 1] = 0.05
    arm = ArmModel.from_dh("offset wrist", dh, ARM.limits)
    with pytest.raises(ValueError, match="d2 = d3 = d5 = 0"):
        inverse(arm, Pose.from_translation([0.4, 0.0, 0.4]))


def test_a_straight_line_stays_on_one_branch() -> None:
    start = ARM.pose_base_flange(T1_JOINTS)
    poses = [start @ Pose.from_translation([0.0, 0.0, step]) for step in np.linspace(0.0, 0.08, 81)]
    path = track(ARM, poses, T1_JOINTS)
    assert path.shape == (81, 6)
    assert np.abs(np.diff(path, axis=0)).max() < 0.02
    assert all(same_pose(ARM.pose_base_flange(q), pose) for q, pose in zip(path, poses, strict=True))


def test_a_line_through_the_wrist_singularity_is_a_jump() -> None:
    # A flange that tips through the forearm's line, 1 mrad beside it: joint 4 has to turn over at once.
    joints = np.array([0.0, 0.3, 0.1, 0.0, 0.3, 0.0])
    start = ARM.pose_base_flange(joints)
    wrist = start @ Pose.from_translation([0.0, 0.0, -0.073])
    beside = Pose.from_rotvec([1e-3, 0.0, 0.0], [0.0, 0.0, 0.0])
    back = Pose.from_translation([0.0, 0.0, 0.073])
    poses = [
        wrist @ beside @ Pose.from_rotvec([0.0, angle, 0.0], [0.0] * 3) @ back for angle in np.linspace(0, 0.6, 61)
    ]
    with pytest.raises(BranchJump, match="near the wrist singularity") as caught:
        track(ARM, poses, joints)
    assert 20 < caught.value.index < 40
    with pytest.raises(Unreachable, match=r"pose 1 of the path"):
        track(ARM, [start, Pose.from_translation([2.0, 0.0, 0.0])], joints)
    with pytest.raises(ValueError, match="empty"):
        track(ARM, [], joints)
