"""Numerical inverse kinematics: the pose is met inside the limits, near the seed, and refusals say why."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.arm import NAMED_ARMS, ArmModel, panda, ur5e, xb4
from crosspih_common.arm.closed_form import ClosedForm
from crosspih_common.arm.inverse import BranchJump, Unreachable, nearest, solver, track
from crosspih_common.arm.numerical import Numerical
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

ARMS = [ur5e(), panda()]
HOME = {arm.name: np.array(NAMED_ARMS[arm.name].home_rad) for arm in ARMS}
each_arm = pytest.mark.parametrize("arm", ARMS, ids=lambda arm: str(arm.name))


def off_by(arm: ArmModel, joints: Array, pose: Pose) -> float:
    """The largest of the distance, m, and the angle, rad."""
    reached = arm.pose_base_flange(joints)
    return max(reached.distance_to_m(pose), float(np.abs(reached.rotation - pose.rotation).max()))


shares = st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7).map(np.array)


@each_arm
@settings(max_examples=60, deadline=None, derandomize=True)
@given(shares, shares)
def test_any_pose_of_the_arm_is_met_from_a_seed_nearby(arm: ArmModel, share: Array, astray: Array) -> None:
    low, high = arm.limits.lower_rad, arm.limits.upper_rad
    joints = low + share[: arm.joints] * (high - low)
    seed = np.clip(joints + 0.2 * (astray[: arm.joints] - 0.5), low, high)
    pose = arm.pose_base_flange(joints)
    found = nearest(arm, pose, seed)
    assert off_by(arm, found, pose) < 1e-9
    assert arm.limits.violations(found) == []


def test_a_pose_in_a_corner_of_the_limits_is_met() -> None:
    arm = panda()
    low, high = arm.limits.lower_rad, arm.limits.upper_rad
    joints = low + np.array([0.0, 0.0, 0.0, 0.0, 0.015625, 0.001953125, 1.0]) * (high - low)
    pose = arm.pose_base_flange(joints)
    assert off_by(arm, nearest(arm, pose, np.clip(joints - 0.1, low, high)), pose) < 1e-9


@each_arm
def test_far_poses_are_met_as_well(arm: ArmModel) -> None:
    rng = np.random.default_rng(2)
    for _ in range(15):
        pose = arm.pose_base_flange(rng.uniform(arm.limits.lower_rad, arm.limits.upper_rad))
        found = nearest(arm, pose, HOME[arm.name])
        assert off_by(arm, found, pose) < 1e-9
        assert arm.limits.violations(found) == []


def test_it_agrees_with_the_closed_form() -> None:
    arm = xb4()
    numerical, closed = Numerical(arm), ClosedForm(arm)
    rng = np.random.default_rng(3)
    for _ in range(50):
        joints = rng.uniform(-0.8, 0.8, 6) + np.array([0.0, 0.5, -0.5, 0.0, 1.2, 0.0])
        pose = arm.pose_base_flange(joints)
        seed = joints + rng.uniform(-0.05, 0.05, 6)
        assert numerical.nearest(pose, seed) == pytest.approx(closed.nearest(pose, seed), abs=1e-8)


def test_the_seventh_joint_stays_as_near_to_the_seed_as_the_pose_allows() -> None:
    arm, seed = panda(), HOME["panda"]
    pose = arm.pose_base_flange(seed) @ Pose.from_translation([0.03, -0.02, 0.04])
    found = nearest(arm, pose, seed)
    # at the nearest posture the way back to the seed is no motion that the pose leaves free
    free = np.linalg.svd(arm.jacobian(found))[2][6]
    assert abs(float(free @ (seed - found))) < 1e-6
    assert nearest(arm, arm.pose_base_flange(seed), seed) == pytest.approx(seed, abs=1e-12)


def test_a_joint_at_its_limit_is_held_and_the_others_make_up_for_it() -> None:
    arm = panda()
    seed = HOME["panda"].copy()
    seed[5] = arm.limits.upper_rad[5]
    pose = arm.pose_base_flange(seed) @ Pose.from_rotvec([0.0, -0.1, 0.0], [0.0, 0.0, 0.0])
    found = nearest(arm, pose, seed)
    assert off_by(arm, found, pose) < 1e-9
    assert arm.limits.violations(found) == []


@each_arm
def test_a_straight_line_is_smooth(arm: ArmModel) -> None:
    start = arm.pose_base_flange(HOME[arm.name])
    poses = [start @ Pose.from_translation([0.0, 0.0, step]) for step in np.linspace(0.0, 0.05, 251)]
    path = track(arm, poses, HOME[arm.name])
    assert path.shape == (251, arm.joints)
    assert max(off_by(arm, joints, pose) for joints, pose in zip(path, poses, strict=True)) < 1e-9
    # third differences are those of a smooth curve: 0.2 mm steps leave no more than rounding and curvature
    assert np.abs(np.diff(path, n=3, axis=0)).max() < 1e-8


def test_beyond_reach_says_what_is_left_and_which_joints_are_singular() -> None:
    arm = ur5e()
    with pytest.raises(Unreachable, match=r"leaves \d+\.\d mm and .* rad; the arm is singular there: joints? .*value"):
        nearest(arm, Pose.from_translation([1.3, 0.0, 0.2]), HOME["ur5e"])


def test_a_limit_in_the_way_is_named() -> None:
    arm = panda()
    folded = np.array([0.0, 0.0, 0.0, -3.05, 0.0, 1.6, 0.0])
    pose = arm.pose_base_flange(folded)
    frames = arm.link_poses(folded)
    # joint 4 alone sets how far the wrist is from the shoulder
    inwards = frames[1].translation_m - frames[5].translation_m
    nearer = Pose(pose.rotation, pose.translation_m + 0.06 * inwards / np.linalg.norm(inwards))
    with pytest.raises(Unreachable, match=r"joint 4 is at its limit -3\.0718 rad"):
        solver(arm).follow(nearer, folded)


def test_a_line_through_a_wrist_singularity_is_named() -> None:
    # joint 5 goes through 0, where axes 4 and 6 are parallel, 1 mrad beside it
    arm = ur5e()
    bent = np.array([0.3, -1.2, 1.5, -0.6, 0.3, 0.4])
    beside = Pose.from_rotvec([1e-3, 1e-3, 0.0], np.zeros(3))
    straightened = [np.array([*bent[:4], angle, bent[5]]) for angle in np.linspace(0.3, -0.3, 61)]
    poses = [arm.pose_base_flange(joints) @ beside for joints in straightened]
    with pytest.raises(BranchJump, match=r"near a singularity of joints .*smallest singular value") as caught:
        track(arm, poses, bent)
    assert 20 < caught.value.index < 40


def test_what_is_no_pose_or_no_seed_is_refused() -> None:
    arm, seed = panda(), HOME["panda"]
    with pytest.raises(Unreachable, match="not finite"):
        nearest(arm, Pose(np.eye(3), np.array([np.nan, 0.0, 0.0])), seed)
    with pytest.raises(Unreachable, match="proper rotation"):
        nearest(arm, Pose(np.diag([1.0, 1.0, -1.0]), np.array([0.4, 0.0, 0.4])), seed)
    with pytest.raises(ValueError, match="seed_joints_rad wants 7 finite angles"):
        nearest(arm, arm.pose_base_flange(seed), seed[:6])


def test_threads_do_not_mix_their_answers() -> None:
    arm, seed = panda(), HOME["panda"]
    rng = np.random.default_rng(4)
    poses = [arm.pose_base_flange(seed + rng.uniform(-0.05, 0.05, 7)) for _ in range(200)]
    alone = [nearest(arm, pose, seed) for pose in poses]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda pose: nearest(arm, pose, seed), poses))
    assert np.array_equal(np.array(alone), np.array(together))
