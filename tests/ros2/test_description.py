"""The arm's URDF and the chain that is read from one, against the arm's own kinematics and against Pinocchio's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crosspih_common.arm import named_arm
from crosspih_common.arm.description import UrdfChain, default_joint_names, urdf_of
from crosspih_common.arm.urdf import arm_from_urdf
from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.ros2.frames import ros_arm

UR5E = Path(__file__).resolve().parents[1] / "arm" / "data" / "ur5e.urdf"
ARMS = ("xb4", "ur5e", "panda")
UNIT = st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7)


def along(chain: UrdfChain, joints_rad: np.ndarray) -> Pose:
    pose = Pose.identity()
    for step in chain.poses(joints_rad):
        pose = pose @ step
    return pose


@pytest.mark.parametrize("name", ARMS)
@given(share=UNIT)
def test_the_chain_of_the_written_urdf_ends_where_the_arm_does(name: str, share: list[float]) -> None:
    model = named_arm(name)
    chain = UrdfChain.of(urdf_of(model, default_joint_names(model), "base_link", "tool0"))
    limits = model.limits
    joints = limits.lower_rad + np.array(share[: model.joints]) * (limits.upper_rad - limits.lower_rad)
    assert np.allclose(along(chain, joints).matrix(), model.pose_base_flange(joints).matrix(), atol=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_pinocchio_reads_the_same_arm_from_it(name: str, tmp_path: Path) -> None:
    model = named_arm(name)
    file = tmp_path / "arm.urdf"
    file.write_text(urdf_of(model, default_joint_names(model), "base_link", "tool0"), encoding="utf-8")
    read = arm_from_urdf(str(file), "base_link", "tool0", {}, np.zeros(0))
    assert np.array_equal(read.limits.upper_rad, model.limits.upper_rad)
    for joints in np.random.default_rng(1).uniform(model.limits.lower_rad, model.limits.upper_rad, (20, model.joints)):
        assert np.allclose(read.pose_base_flange(joints).matrix(), model.pose_base_flange(joints).matrix(), atol=1e-9)


def test_a_makers_urdf_is_told_as_it_is() -> None:
    cell = {
        "arm": {"urdf": str(UR5E), "tip_link": "tool0"}, "home_joints_rad": (0.0, -1.5, 1.5, 0.0, 1.5, 0.0),
        "joint_stiffness_nm_rad": (1e4,) * 6,
    }  # fmt: skip
    workcell = Workcell.model_validate(cell)
    arm = ros_arm(workcell, "ros2")
    assert arm.urdf == UR5E.read_text(encoding="utf-8")
    assert arm.chain.joint_names[:2] == ("shoulder_pan_joint", "shoulder_lift_joint")
    joints = np.array([0.1, -1.2, 1.3, -0.4, 0.5, 0.6])
    assert np.allclose(along(arm.chain, joints).matrix(), workcell.arm().pose_base_flange(joints).matrix(), atol=1e-9)
    with pytest.raises(ConfigError, match=r"ros2.joint_names: the URDF file of cell.arm says it"):
        ros_arm(workcell, "ros2", ("a",) * 6)


def test_names_are_as_many_as_joints_and_differ() -> None:
    with pytest.raises(ConfigError, match=r"ros2.joint_names: 5 names, want 6 that differ"):
        ros_arm(Workcell(), "ros2", tuple("abcde"))
    with pytest.raises(ConfigError, match=r"6 names, want 6 that differ"):
        ros_arm(Workcell(), "ros2", tuple("aabcde"))
    assert ros_arm(Workcell(), "ros2").chain.joint_names == tuple(f"joint_{index}" for index in range(1, 7))


def test_a_broken_chain_is_named() -> None:
    for text, why in (
        ("<robot", "no XML"),
        ("<robot><link name='a'/><link name='b'/></robot>", "tip_link: the URDF has 2 such links"),
        ("<robot><link name='a'/><joint name='j' type='fixed'/></robot>", "joint 'j' has no parent"),
    ):
        with pytest.raises(ValueError, match=why):
            UrdfChain.of(text)
