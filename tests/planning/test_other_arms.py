"""Planning with the shipped cells of other arms: the way to the hole, into it, and the calibration's poses."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.arm.inverse import nearest
from crosspih_common.config import Workcell, load_cell
from crosspih_common.geometry import Pose
from services.planning.trajectory import joined, move_joints, move_line, scaled_limits

CELLS = ["default", "ur5e", "panda"]


def workcell_of(name: str) -> Workcell:
    return load_cell(f"deploy/cells/{name}.yaml").workcell


@pytest.mark.parametrize("name", CELLS)
def test_every_hole_in_range_is_reached_and_entered_inside_the_limits(name: str) -> None:
    workcell = workcell_of(name)
    arm, tip_m = workcell.arm(), workcell.peg.shape().tip_m
    mounting = workcell.pose_flange_peg()
    limits = scaled_limits(arm.limits, 0.5, 0.3)
    home = np.array(workcell.home_joints_rad)
    rng = np.random.default_rng(1)
    for _ in range(5):
        off = rng.uniform(-1.0, 1.0, 6) * workcell.hole_prior.half_ranges()
        hole = workcell.hole_prior.pose_base_hole() @ Pose.from_rotvec(off[3:], off[:3])
        before = nearest(arm, hole @ Pose.from_translation([0.0, 0.0, -tip_m - 0.06]) @ mounting.inverse(), home)
        free = move_joints(home, before, limits)
        entry = move_line(
            arm, before, hole @ Pose.from_translation([0.0, 0.0, -tip_m + 0.08]), limits, pose_flange_point=mounting
        )
        assert joined([free, entry]).violations(limits) == []
        assert free.duration_s + entry.duration_s < 5.0
        for time in np.linspace(0.0, entry.duration_s, 50):
            at = hole.inverse() @ arm.pose_base_flange(entry.sample(float(time)).position_rad) @ mounting
            assert np.hypot(*at.translation_m[:2]) < 1e-7
            assert at.angle_to_rad(Pose.identity()) < 1e-6


@pytest.mark.parametrize("name", CELLS)
def test_the_tool_is_as_stiff_as_the_mechanics_expect_all_along_the_hole(name: str) -> None:
    workcell = workcell_of(name)
    hole, tip_m = workcell.hole_prior.pose_base_hole(), workcell.peg.shape().tip_m
    for depth_m in (-0.06, 0.0, 0.06):
        pose = hole @ Pose.from_translation([0.0, 0.0, depth_m - tip_m]) @ workcell.pose_flange_peg().inverse()
        compliance = workcell.compliance_peg(nearest(workcell.arm(), pose, workcell.home_joints_rad))
        stiffness_n_mm = 1e-3 / np.diag(compliance)[:3]
        assert np.all((stiffness_n_mm > 50.0) & (stiffness_n_mm < 300.0))
