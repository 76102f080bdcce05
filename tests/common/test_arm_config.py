"""The arm in a cell's file: by name, by table, by URDF file; what is wrong is named with the field and the mend."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.arm import NAMED_ARMS, xb4
from crosspih_common.config import Workcell, load_cell
from crosspih_common.errors import ConfigError

UR5E = Path(__file__).parent.parent / "arm" / "data" / "ur5e.urdf"
ROWS = "[[0, 0.1625, 0, 1.5708], [0, 0, -0.425, 0], [0, 0, -0.3922, 0], [0, 0.1333, 0, 1.5708], [0, 0.0997, 0, -1.5708], [0, 0.0996, 0, 0]]"  # noqa: E501
LIMITS = (
    "lower_rad: [-3, -3, -3, -3, -3, -3], upper_rad: [3, 3, 3, 3, 3, 3], speed_rad_s: [1, 1, 1, 1, 1, 1], "
    "acceleration_rad_s2: [2, 2, 2, 2, 2, 2]"
)
OWN = "home_joints_rad: [0, -1, 1, 0, 1, 0], joint_stiffness_nm_rad: [9e3, 9e3, 9e3, 9e3, 9e3, 9e3]"


def cell(folder: Path, text: str) -> Workcell:
    file = folder / "cell.yaml"
    file.write_text(f"cell: {{{text}}}\n", encoding="utf-8")
    return load_cell(file).workcell


def test_without_a_word_it_is_the_xb4() -> None:
    workcell = Workcell()
    assert workcell.arm() is xb4() is Workcell().arm()
    assert workcell.home_joints_rad == (-1.44, 0.98, 0.09, -1.35, -1.62, -0.07)
    assert workcell.pose_flange_peg().matrix().tolist()[2] == [0.0, 0.0, 1.0, 0.0663]


@pytest.mark.parametrize("name", list(NAMED_ARMS))
def test_a_named_arm_brings_its_own_home_and_stiffness(tmp_path: Path, name: str) -> None:
    workcell = cell(tmp_path, f"arm: {{name: {name}}}")
    assert workcell.arm().name == name
    assert workcell.home_joints_rad == NAMED_ARMS[name].home_rad
    assert workcell.joint_stiffness_nm_rad == NAMED_ARMS[name].stiffness_nm_rad
    compliance = workcell.compliance_peg(workcell.home_joints_rad)
    assert np.all(np.linalg.eigvalsh(compliance) > 0.0)


def test_a_table_is_an_arm(tmp_path: Path) -> None:
    workcell = cell(tmp_path, f"arm: {{dh: {ROWS}, {LIMITS}}}, {OWN}")
    assert workcell.arm().joints == 6
    assert workcell.arm().pose_base_flange(np.zeros(6)).translation_m == pytest.approx(
        [-0.8172, -0.2329, 0.0628], abs=1e-5
    )
    assert workcell.arm() is workcell.arm()


def test_a_modified_table_has_its_flange_behind_the_last_frame(tmp_path: Path) -> None:
    workcell = cell(
        tmp_path,
        f"arm: {{dh: {ROWS}, dh_convention: modified, last_to_flange: {{position_m: [0, 0, 0.2]}}, {LIMITS}}}, {OWN}",
    )
    frames = workcell.arm().link_poses(workcell.home_joints_rad)
    assert frames[-1].translation_m == pytest.approx(frames[-2].apply([0.0, 0.0, 0.2 + 0.0996]), abs=1e-12)


def test_a_urdf_file_lies_beside_the_cells_file(tmp_path: Path) -> None:
    shutil.copy(UR5E, tmp_path / "my.urdf")
    workcell = cell(tmp_path, f"arm: {{urdf: my.urdf, tip_link: tool0, speed_rad_s: [1, 1, 1, 1, 1, 1]}}, {OWN}")
    assert workcell.arm().name == "ur5e"
    assert workcell.arm().limits.speed_rad_s.tolist() == [1.0] * 6


def test_limits_and_mounting_can_be_the_cells_own(tmp_path: Path) -> None:
    workcell = cell(
        tmp_path,
        "arm: {name: panda, speed_rad_s: [1, 1, 1, 1, 1, 1, 1]}, "
        "flange_to_ft: {position_m: [0.01, 0, 0.1], rotvec_rad: [0, 0, 0.7]}",
    )
    assert workcell.arm().limits.speed_rad_s.tolist() == [1.0] * 7
    assert workcell.pose_flange_peg().translation_m.tolist() == [0.01, 0.0, 0.1]
    assert workcell.pose_flange_peg().rotvec_rad() == pytest.approx([0.0, 0.0, 0.7])
    assert cell(tmp_path, "flange_to_ft_m: 0.08").pose_flange_peg().translation_m.tolist() == [0.0, 0.0, 0.08]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("arm: {name: ur3}", r"cell\.arm\.name: Input should be 'xb4', 'ur5e' or 'panda'"),
        ("arm: {}", "wants one of name .* got none"),
        ("arm: {name: xb4, urdf: a.urdf}", "got name and urdf"),
        ("arm: {name: xb4, tip_link: a}", "tip_link means nothing without urdf; leave it out"),
        ("arm: {urdf: none.urdf}", r"none\.urdf: cannot be read as URDF"),
        (f"arm: {{dh: {ROWS}}}", "a DH table says nothing of limits; give lower_rad, upper_rad"),
        (f"arm: {{dh: {ROWS}, last_to_flange: {{}}, {LIMITS}}}", "last_to_flange means nothing in a standard DH table"),
        (f"arm: {{dh: {ROWS}, {LIMITS}}}", "home_joints_rad: the arm 'dh' has none of its own; give 6 numbers"),
        ("arm: {name: panda, speed_rad_s: [1, 1, 1, 1, 1, 1]}", "speed_rad_s wants 7 numbers for the arm 'panda'"),
        ("arm: {name: panda}, home_joints_rad: [0, 0, 0, -1, 0, 1]", "home_joints_rad: has 6 numbers, give 7"),
        ("joint_stiffness_nm_rad: [1, 1, 1, 1, 1, 1, 1]", "joint_stiffness_nm_rad: has 7 numbers, give 6"),
        ("joint_stiffness_nm_rad: [1, 1, 1, 1, 1, 0]", "joint_stiffness_nm_rad: wants numbers above 0"),
        ("home_joints_rad: [0, 9, 0, 0, 0, 0]", "home_joints_rad: joint 2 at 9.0000 rad is outside"),
        ("flange_to_ft_m: 0.1, flange_to_ft: {position_m: [0, 0, 0.1]}", "says the same as flange_to_ft; leave it out"),
        ("arm: {name: xb4, lower_rad: [9, 0, 0, 0, 0, 0]}", "lower_rad of joint 1 is not below its upper_rad"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        cell(tmp_path, text)


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_the_shipped_cells_see_their_hole_as_the_default_cell_does(name: str) -> None:
    workcell, default = load_cell(f"deploy/cells/{name}.yaml").workcell, Workcell()
    seen = workcell.camera.pose_base_camera().inverse() @ workcell.hole_prior.pose_base_hole()
    as_ever = default.camera.pose_base_camera().inverse() @ default.hole_prior.pose_base_hole()
    assert seen.matrix() == pytest.approx(as_ever.matrix(), abs=1e-9)
