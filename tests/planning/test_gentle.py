"""How fast a cell is touched, by what is declared of its stiffness."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.arm.inverse import nearest
from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.planning.config import PlanningConfig
from services.planning.gentle import LOOP_PER_S, OBSERVE_S, REACTION_S, Gentle

CONFIG = PlanningConfig()
USUAL = np.asarray(Workcell().joint_stiffness_nm_rad)


def cell(stiffer: float = 1.0, contact_n_m: float | None = None) -> Workcell:
    return Workcell(joint_stiffness_nm_rad=tuple((USUAL * stiffer).tolist()), contact_stiffness_n_m=contact_n_m)


def at_hole(workcell: Workcell) -> Array:
    """The joints with the tip on the nominal hole's face."""
    peg = workcell.hole_prior.pose_base_hole() @ Pose.from_translation([0.0, 0.0, -workcell.peg.shape().tip_m])
    return nearest(workcell.arm(), peg @ workcell.pose_flange_peg().inverse(), workcell.home_joints_rad)


def gentle(workcell: Workcell) -> Gentle:
    return Gentle.at(workcell, at_hole(workcell))


def test_the_default_cell_goes_at_its_configured_speeds() -> None:
    found = gentle(cell())
    assert found.probe_speed_m_s(CONFIG) == CONFIG.probe_speed_m_s
    assert found.touch_speed_m_s(CONFIG, CONFIG.touch_speed_m_s) == CONFIG.touch_speed_m_s
    assert found.creep_m_s(CONFIG) == CONFIG.touch_creep_m_s
    assert found.press_creep_m_s(CONFIG) == CONFIG.press_creep_m_s
    assert found.push_speed_m_s(CONFIG, CONFIG.push_force_n) == CONFIG.push_speed_m_s
    assert found.rotational_damping_nm_s_rad(20.0) == 20.0


@pytest.mark.parametrize("stiffer", [1.0, 2.0, 6.0, 20.0])
@pytest.mark.parametrize("contact_n_m", [None, 3e4, 3e5])
def test_what_a_touch_adds_is_bounded_whatever_the_stiffness(stiffer: float, contact_n_m: float | None) -> None:
    found = gentle(cell(stiffer, contact_n_m))
    assert found.along_n_m * found.creep_m_s(CONFIG) * OBSERVE_S <= CONFIG.touch_adds_n * (1.0 + 1e-9)
    assert found.along_n_m * found.probe_speed_m_s(CONFIG) * REACTION_S <= CONFIG.touch_reaction_n * (1.0 + 1e-9)
    assert found.across_n_m * found.press_creep_m_s(CONFIG) * OBSERVE_S <= CONFIG.press_force_n * (1.0 + 1e-9)
    assert found.turn_nm_rad / found.rotational_damping_nm_s_rad(20.0) <= LOOP_PER_S * (1.0 + 1e-9)
    for force_n in (3.0, 12.0):
        assert found.along_n_m * found.push_speed_m_s(CONFIG, force_n) / force_n <= LOOP_PER_S * (1.0 + 1e-9)


def test_a_soft_contact_stands_in_series_with_the_arm() -> None:
    alone, soft = gentle(cell()), gentle(cell(contact_n_m=1e5))
    assert 1.0 / soft.along_n_m == pytest.approx(1.0 / alone.along_n_m + 1e-5)
    assert soft.turn_nm_rad < alone.turn_nm_rad
    assert gentle(cell(1e3, 1e5)).along_n_m == pytest.approx(1e5, rel=0.01)


def test_only_a_declared_contact_adds_to_the_arms_compliance() -> None:
    rigid, soft = cell(), cell(contact_n_m=1e5)
    joints = at_hole(rigid)
    np.testing.assert_array_equal(rigid.compliance_peg(joints), rigid.arm_compliance_peg(joints))
    np.testing.assert_array_equal(soft.arm_compliance_peg(joints), rigid.arm_compliance_peg(joints))
    added = soft.compliance_peg(joints) - soft.arm_compliance_peg(joints)
    np.testing.assert_allclose(added, np.diag([1e-5, 1e-5, 1e-5, 0.0, 0.0, 0.0]), atol=1e-18)
