"""An arm from a URDF file: the chain between two links, whatever way the joints' axes point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio
import pytest

from crosspih_common.arm import ur5e
from crosspih_common.arm.urdf import ACCELERATION_RAD_S2, arm_from_urdf
from crosspih_common.geometry import Pose

UR5E = Path(__file__).parent / "data" / "ur5e.urdf"
AXES = ("0 0 1", "0 -1 0", "1 0 0", "0 0 -1", "0.6 0.8 0", "0 1 0")


def crooked(folder: Path, kind: str = "revolute", gripper: bool = False) -> Path:
    """A file of six joints about all sorts of axes, the fourth continuous, the first of `kind`."""
    parts = ['<robot name="crooked"><link name="world"/><link name="base"/>']
    parts.append(
        '<joint name="foot" type="fixed"><parent link="world"/><child link="base"/>'
        '<origin xyz="0.1 0.2 0.3" rpy="0.1 0 0"/></joint>'
    )
    for index, axis in enumerate(AXES):
        parent = "base" if index == 0 else f"link{index}"
        of = kind if index == 0 else "continuous" if index == 3 else "revolute"
        parts.append(
            f'<link name="link{index + 1}"/><joint name="joint{index + 1}" type="{of}"><parent link="{parent}"/>'
            f'<child link="link{index + 1}"/><origin xyz="0.0{index} 0.1 0.2" rpy="0.{index} 0.2 0.3"/>'
            f'<axis xyz="{axis}"/><limit lower="-2" upper="2.{index}" velocity="1.5" effort="1"/></joint>'
        )
    for name in ("flange", "finger")[: 2 if gripper else 1]:
        of = "fixed" if name == "flange" else "prismatic"
        parts.append(
            f'<link name="{name}"/><joint name="to_{name}" type="{of}"><parent link="link6"/><child link="{name}"/>'
            '<origin xyz="0 0 0.1" rpy="0.5 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>'
        )
    path = folder / "crooked.urdf"
    path.write_text("".join(parts) + "</robot>", encoding="utf-8")
    return path


@pytest.mark.parametrize("base", [None, "base", "world"])
def test_the_chain_is_the_one_that_pinocchio_walks(tmp_path: Path, base: str | None) -> None:
    path = crooked(tmp_path)
    arm = arm_from_urdf(path, base)
    model = pinocchio.buildModelFromUrdf(str(path))
    data = model.createData()
    for joints in np.random.default_rng(0).uniform(-1.5, 1.5, (10, 6)):
        configuration = np.array([*joints[:3], np.cos(joints[3]), np.sin(joints[3]), *joints[4:]])
        pinocchio.framesForwardKinematics(model, data, configuration)
        start = data.oMf[model.getFrameId(base or "world")]
        witness = (start.inverse() * data.oMf[model.getFrameId("flange")]).homogeneous
        assert arm.pose_base_flange(joints).matrix() == pytest.approx(witness, abs=1e-12)
    assert arm.limits.upper_rad == pytest.approx([2.0, 2.1, 2.2, 2.0 * np.pi, 2.4, 2.5])
    assert arm.limits.acceleration_rad_s2 == pytest.approx([ACCELERATION_RAD_S2] * 6)


def test_the_ur5e_from_its_urdf_is_the_named_one() -> None:
    arm = arm_from_urdf(UR5E, "base_link_inertia", "tool0")
    for joints in np.random.default_rng(0).uniform(-3.0, 3.0, (10, 6)):
        assert arm.pose_base_flange(joints).matrix() == pytest.approx(
            ur5e().pose_base_flange(joints).matrix(), abs=1e-9
        )
    assert arm.limits.lower_rad == pytest.approx(ur5e().limits.lower_rad)
    assert arm.limits.speed_rad_s == pytest.approx(ur5e().limits.speed_rad_s)


def test_a_gripper_behind_the_flange_is_left_out(tmp_path: Path) -> None:
    path = crooked(tmp_path, gripper=True)
    with pytest.raises(ValueError, match=r"tip_link: .* ends in finger, flange; name the one that is the flange"):
        arm_from_urdf(path)
    assert arm_from_urdf(path, tip_link="flange").joints == 6


def test_refusals_name_the_field(tmp_path: Path) -> None:
    path = crooked(tmp_path)
    with pytest.raises(ValueError, match=r"tip_link: .* has no link 'tool'; want one of world, base, link1"):
        arm_from_urdf(path, tip_link="tool")
    with pytest.raises(ValueError, match="tip_link: 3 joints lead from 'world' to 'link3'"):
        arm_from_urdf(path, tip_link="link3")
    with pytest.raises(ValueError, match="tip_link: no chain of joints leads from 'link3' to 'base'"):
        arm_from_urdf(path, "link3", "base")
    with pytest.raises(ValueError, match="joint 'joint1' slides, want revolute joints only"):
        arm_from_urdf(crooked(tmp_path, kind="prismatic"))
    broken = tmp_path / "broken.urdf"
    broken.write_text("<robot", encoding="utf-8")
    with pytest.raises(ValueError, match=r"broken\.urdf: cannot be read as URDF"):
        arm_from_urdf(broken)
    with pytest.raises(ValueError, match=r"nothing\.urdf: cannot be read as URDF"):
        arm_from_urdf(tmp_path / "nothing.urdf")


def test_limits_of_the_file_can_be_replaced(tmp_path: Path) -> None:
    arm = arm_from_urdf(crooked(tmp_path), limits={"lower_rad": [-1.0] * 6, "acceleration_rad_s2": [3.0] * 6})
    assert arm.limits.lower_rad.tolist() == [-1.0] * 6
    assert arm.limits.acceleration_rad_s2.tolist() == [3.0] * 6
    assert Pose.identity().distance_to_m(arm.pose_base_flange(np.zeros(6))) > 0.5
