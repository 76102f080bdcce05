"""The named arms against published poses and against independent implementations of their kinematics.

Witnesses: for the UR5e the maker's ROS description (its default_kinematics.yaml, another parametrisation than the DH
table) through Pinocchio; for the Panda the URDF that comes with PyBullet, through PyBullet's own forward kinematics.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import Rotation

from crosspih_common.arm import NAMED_ARMS, ArmModel, named_arm, panda, ur5e, xb4
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

DATA = Path(__file__).parent / "data"
QUARTER = np.pi / 2


def random_joints(arm: ArmModel, count: int) -> Array:
    rng = np.random.default_rng(7)
    return rng.uniform(arm.limits.lower_rad, arm.limits.upper_rad, (count, arm.joints))


def test_the_ur5e_at_zero_is_where_its_maker_says() -> None:
    pose = ur5e().pose_base_flange(np.zeros(6))
    assert pose.translation_m == pytest.approx([-0.8172, -0.2329, 0.0628], abs=1e-9)
    assert pose.rotation == pytest.approx(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), abs=1e-12)


def test_the_panda_at_its_ready_pose_is_where_its_maker_says() -> None:
    # the start pose of libfranka's examples; the hand is 0.1034 m ahead of the flange, turned by -45 degrees
    flange = panda().pose_base_flange([0.0, -QUARTER / 2, 0.0, -1.5 * QUARTER, 0.0, QUARTER, QUARTER / 2])
    hand = flange @ Pose.from_rotvec([0.0, 0.0, -QUARTER / 2], [0.0, 0.0, 0.1034])
    assert hand.translation_m == pytest.approx([0.3069, 0.0, 0.4869], abs=1e-4)
    assert hand.rotation == pytest.approx(np.diag([1.0, -1.0, -1.0]), abs=1e-12)


def test_the_ur5e_agrees_with_the_makers_ros_description() -> None:
    model = pinocchio.buildModelFromUrdf(str(DATA / "ur5e.urdf"))
    data = model.createData()
    # the ROS description's base_link is turned by half a turn against the controller's base
    pose_base_ros = Pose.from_rotvec([0.0, 0.0, np.pi], [0.0, 0.0, 0.0])
    for joints in random_joints(ur5e(), 50):
        pinocchio.framesForwardKinematics(model, data, joints)
        witness = pose_base_ros.matrix() @ data.oMf[model.getFrameId("tool0")].homogeneous
        assert ur5e().pose_base_flange(joints).matrix() == pytest.approx(witness, abs=1e-9)


# x y z, m, and roll pitch yaw, rad, of each joint's frame in the one before: Universal Robots,
# Universal_Robots_ROS2_Description, config/ur5e/default_kinematics.yaml (commit 2221ec0, BSD-3-Clause)
UR5E_AS_PUBLISHED = (
    ("shoulder", (0.0, 0.0, 0.1625), (0.0, 0.0, 0.0)),
    ("upper_arm", (0.0, 0.0, 0.0), (1.570796327, 0.0, 0.0)),
    ("forearm", (-0.425, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ("wrist_1", (-0.3922, 0.0, 0.1333), (0.0, 0.0, 0.0)),
    ("wrist_2", (0.0, -0.0997, -2.044881182297852e-11), (1.570796327, 0.0, 0.0)),
    ("wrist_3", (0.0, 0.09959999999999999, -2.042830148012698e-11), (1.570796326589793, np.pi, np.pi)),
)
# place of each joint's body in the one before, its turn about y, and the joint's axis: DeepMind, mujoco_menagerie,
# universal_robots_ur5e/ur5e.xml (commit 1b428b0, BSD-3-Clause), whose lengths are whole millimetres
UR5E_OF_MENAGERIE = (
    ((0.0, 0.0, 0.163), 0.0, "z"),
    ((0.0, 0.138, 0.0), QUARTER, "y"),
    ((0.0, -0.131, 0.425), 0.0, "y"),
    ((0.0, 0.0, 0.392), QUARTER, "y"),
    ((0.0, 0.127, 0.0), 0.0, "z"),
    ((0.0, 0.0, 0.1), 0.0, "y"),
)
HALF_TURN = Rotation.from_euler("z", np.pi)  # of its base against the controller's


def test_the_ur5e_agrees_with_its_makers_numbers_put_together_by_scipy_alone() -> None:
    """From base_link_inertia, half a turn from base_link and so the controller's base, to the flange's frame, tool0."""
    for joints in random_joints(ur5e(), 50):
        rotation, place = Rotation.identity(), np.zeros(3)
        for (_, shift_m, turn_rad), angle in zip(UR5E_AS_PUBLISHED, joints, strict=True):
            place = place + rotation.apply(shift_m)
            rotation = rotation * Rotation.from_euler("xyz", turn_rad) * Rotation.from_euler("z", angle)
        pose = ur5e().pose_base_flange(joints)
        assert pose.translation_m == pytest.approx(place, abs=1e-8)
        assert pose.rotation == pytest.approx(rotation.as_matrix(), abs=1e-8)


def test_the_ur5e_agrees_with_the_menageries_but_for_its_rounding() -> None:
    """Its flange is 0.1 m ahead along the last joint's axis, y. 0.5, 0.7, 0.2, 0.3 and 0.4 mm are rounded away."""
    for joints in random_joints(ur5e(), 50):
        rotation, place = HALF_TURN, np.zeros(3)
        for (shift_m, turn_rad, axis), angle in zip(UR5E_OF_MENAGERIE, joints, strict=True):
            place = place + rotation.apply(shift_m)
            rotation = rotation * Rotation.from_euler("y", turn_rad) * Rotation.from_euler(axis, angle)
        place = place + rotation.apply([0.0, 0.1, 0.0])
        pose = ur5e().pose_base_flange(joints)
        assert np.linalg.norm(pose.translation_m - place) < 2.1e-3
        assert pose.rotation[:, 2] == pytest.approx(rotation.apply([0.0, 1.0, 0.0]), abs=1e-9)


def test_the_panda_agrees_with_pybullets_own() -> None:
    pybullet = pytest.importorskip("pybullet")
    pybullet_data = pytest.importorskip("pybullet_data")
    client = pybullet.connect(pybullet.DIRECT)
    try:
        path = str(Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf")
        body = pybullet.loadURDF(path, useFixedBase=True, physicsClientId=client)
        for joints in random_joints(panda(), 20):
            for index, angle in enumerate(joints.tolist()):
                pybullet.resetJointState(body, index, angle, physicsClientId=client)
            # link 7 of the file is panda_link8, the flange
            state = pybullet.getLinkState(body, 7, computeForwardKinematics=True, physicsClientId=client)
            witness = Pose.from_quaternion(state[5], state[4])
            pose = panda().pose_base_flange(joints)
            # single precision
            assert pose.distance_to_m(witness) < 2e-6
            assert pose.angle_to_rad(witness) < 2e-6
    finally:
        pybullet.disconnect(client)


@pytest.mark.parametrize("arm", [xb4(), ur5e(), panda()], ids=lambda arm: str(arm.name))
def test_the_jacobian_is_the_slope_of_the_pose(arm: ArmModel) -> None:
    point = Pose.from_rotvec([0.1, 0.2, 0.3], [0.02, -0.03, 0.15])
    for joints in random_joints(arm, 5):
        jacobian = arm.jacobian(joints, point)
        assert jacobian.shape == (6, arm.joints)
        for index in range(arm.joints):
            step = np.zeros(arm.joints)
            step[index] = 1e-6
            ahead, behind = (arm.pose_base_flange(joints + sign * step) @ point for sign in (1.0, -1.0))
            slope = np.concatenate(
                [
                    ahead.translation_m - behind.translation_m,
                    behind.rotation @ (behind.inverse() @ ahead).rotvec_rad(),
                ]
            )
            assert jacobian[:, index] == pytest.approx(slope / 2e-6, abs=1e-8)


@pytest.mark.parametrize("arm", [xb4(), ur5e(), panda()], ids=lambda arm: str(arm.name))
def test_many_points_at_once_are_where_the_flange_is(arm: ArmModel) -> None:
    joints = random_joints(arm, 10)
    point = np.array([0.01, -0.02, 0.15])
    one_by_one = [arm.pose_base_flange(row).apply(point) for row in joints]
    assert arm.points_base_m(joints, point) == pytest.approx(np.array(one_by_one), abs=1e-12)


@pytest.mark.parametrize("arm", [xb4(), ur5e(), panda()], ids=lambda arm: str(arm.name))
def test_each_joint_turns_what_is_behind_it_about_its_axis(arm: ArmModel) -> None:
    joints = random_joints(arm, 1)[0]
    frames = arm.link_poses(joints)
    assert len(frames) == arm.joints + 1
    for index in range(arm.joints):
        turned = joints.copy()
        turned[index] += 0.3
        moved = arm.link_poses(turned)
        axis = frames[index]
        about = axis @ Pose.from_rotvec([0.0, 0.0, 0.3], [0.0, 0.0, 0.0]) @ axis.inverse()
        for behind in range(index + 1, arm.joints + 1):
            assert (about @ frames[behind]).matrix() == pytest.approx(moved[behind].matrix(), abs=1e-12)
        for before in range(index + 1):
            assert np.array_equal(frames[before].matrix(), moved[before].matrix())


def test_every_named_arm_has_a_home_inside_its_limits() -> None:
    for name, named in NAMED_ARMS.items():
        arm = named_arm(name)
        assert arm.limits.violations(named.home_rad) == []
        assert len(named.stiffness_nm_rad) == arm.joints
    with pytest.raises(ValueError, match="want one of xb4, ur5e, panda"):
        named_arm("ur3")


def test_an_arm_of_five_joints_is_refused() -> None:
    limits = xb4().limits
    with pytest.raises(ValueError, match="has 5 joints, want 6 or 7"):
        ArmModel.from_dh("short", np.zeros((5, 4)), limits)
    with pytest.raises(ValueError, match="limits of 7 joints"):
        ArmModel.from_dh("long", np.zeros((7, 4)), limits)
    with pytest.raises(ValueError, match="speed_rad_s wants 6 numbers for the arm 'xb4', got 7"):
        xb4().changed({"speed_rad_s": np.ones(7)})
