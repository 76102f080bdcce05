"""Pushes with several contacts: the law they obey, known answers, and PyBullet's own contacts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.geometry import Pose, rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import CrossPeg
from services.inference.mechanics import (
    PairTables,
    PushSettings,
    SurfacePair,
    contact_geometry,
    contact_wrench_basis,
    first_contact,
    push,
)
from services.inference.mechanics.complementarity import contact_forces
from tests.inference.push_agreement import agreements

PEG = CrossPeg()
TABLES = PairTables.of(PEG, PEG.hole(1e-4, 1e-3))
SURFACES = SurfacePair.of(TABLES)
STIFFNESS_N_M = 1e5
COMPLIANCE = np.diag([1.0 / STIFFNESS_N_M] * 3 + [1e-3] * 3)
ALONG = np.array([0.0, 0.0, 1.0])


def before_the_hole(count: int, turn_rad: float, aside_m: float, seed: int) -> tuple[Array, Array, Array]:
    """Poses with the tip 10 mm before the face, and the direction of the hole's axis."""
    rng = np.random.default_rng(seed)
    rotation = np.swapaxes(rotation_from_error_angles(rng.uniform(-turn_rad, turn_rad, (count, 3))), 1, 2)
    tip = np.column_stack([rng.uniform(-aside_m, aside_m, (count, 2)), np.full(count, -0.01)])
    return rotation, tip - rotation @ np.array([0.0, 0.0, PEG.tip_m]), np.tile(ALONG, (count, 1))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 5), st.floats(0.0, 0.4))
def test_forces_obey_the_law_of_contact_and_of_friction(seed: int, contacts: int, friction: float) -> None:
    """f >= 0, u >= 0, f u = 0; within the cone where it sticks, on it and against the slip where it slides."""
    rng = np.random.default_rng(seed)
    basis = rng.normal(size=(contacts * 3, 6)) * [1, 1, 1, 0.05, 0.05, 0.05]
    # Random contacts may be too many for six degrees of freedom; a little compliance of each keeps forces unique.
    delassus = basis @ COMPLIANCE @ basis.T + 1e-5 * np.eye(contacts * 3)
    free = rng.uniform(-3e-4, 1e-4, (1, contacts, 3))
    found = contact_forces(
        delassus.reshape(1, contacts, 3, contacts, 3),
        free,
        np.array([friction]),
        np.zeros((1, contacts, 3)),
        sweeps=5000,
        tolerance_n=1e-9,
    )
    if found.residual_n[0] > 1e-9:
        return  # Coulomb's law may have no answer, or none that the sweeps reach; then the residual says so.
    force = found.forces_n[0]
    moved = free[0] + (delassus @ force.ravel()).reshape(contacts, 3)
    assert np.all(force[:, 0] >= 0.0)
    assert np.all(moved[:, 0] > -1e-11)
    assert np.max(np.abs(force[:, 0] * moved[:, 0])) < 1e-9
    sideways = np.linalg.norm(force[:, 1:], axis=1)
    assert np.all(sideways <= friction * force[:, 0] + 1e-9)
    slip = np.linalg.norm(moved[:, 1:], axis=1)
    slides = (slip > 1e-9) & (force[:, 0] > 1e-6)
    power = np.einsum("mi,mi->m", force[:, 1:], moved[:, 1:])
    assert power[slides] == pytest.approx(-(friction * force[:, 0] * slip)[slides], rel=1e-3, abs=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.3])
def test_a_single_contact_gives_the_closed_formula(friction: float) -> None:
    """Direction of the force as of `contact_wrench_basis`, at a pose where the contact has just no gap."""
    rotation, translation, motion = before_the_hole(40, 0.08, 0.003, 0)
    found = push(TABLES, SURFACES, rotation, translation, motion, 2e-4, COMPLIANCE, friction)
    assert found.residual_n.max() < 1e-5
    first = first_contact(TABLES, found.rotation, found.translation_m, motion)
    geometry = contact_geometry(first.features, found.rotation, found.translation_m)
    expected = contact_wrench_basis(
        geometry.normal_peg, geometry.point_peg_m, np.einsum("nji,nj->ni", rotation, motion), friction, COMPLIANCE
    )
    single = found.pressing.sum(axis=1) == 1
    assert np.count_nonzero(single) > 30
    assert np.abs(first.travel_m[single]).max() < 1e-8
    one, other = found.wrench_peg[single, :3], expected[single, :3]
    sine = np.linalg.norm(np.cross(one, other), axis=1) / np.linalg.norm(one, axis=1) / np.linalg.norm(other, axis=1)
    # The formula leaves out how the friction itself bends the wrist: an effect of the coefficient squared.
    assert np.degrees(np.arcsin(sine)).max() < 0.01 + 2.5 * friction**2


def test_the_wrist_balances_the_contacts() -> None:
    """The peg is where the compliance puts it under the sum of the contact forces, whatever touches."""
    rotation, translation, motion = before_the_hole(60, 0.01, 0.0003, 1)
    travel = first_contact(TABLES, rotation, translation, motion).travel_m
    found = push(TABLES, SURFACES, rotation, translation, motion, 4e-4, COMPLIANCE, 0.1)
    assert np.count_nonzero(found.pressing.sum(axis=1) > 1) > 5
    for index in range(60):
        wrench = found.wrench_peg[index]
        moments = np.cross(found.point_peg_m[index], found.force_peg_n[index])
        assert wrench == pytest.approx(np.hstack([found.force_peg_n[index], moments]).sum(axis=0), abs=1e-9)
        twist = COMPLIANCE @ wrench
        commanded = Pose(rotation[index], translation[index] + (travel[index] + 4e-4) * motion[index])
        there = commanded @ Pose.from_rotvec(twist[3:], twist[:3])
        assert there.distance_to_m(Pose(found.rotation[index], found.translation_m[index])) < 1e-7
        assert there.angle_to_rad(Pose(found.rotation[index], found.translation_m[index])) < 1e-6


def test_a_flat_tip_on_the_face_presses_like_a_spring() -> None:
    """An upright peg beside the hole: force = stiffness x travel, along the axis, from several points, no moment."""
    translation = np.array([[0.044, 0.0, -PEG.tip_m - 0.001]])
    found = push(TABLES, SURFACES, np.eye(3)[None], translation, ALONG[None], 1e-4, COMPLIANCE, 0.1)
    assert found.travel_m[0] == pytest.approx(0.001, abs=1e-9)
    assert found.pressing[0].sum() >= 3
    assert found.wrench_peg[0] == pytest.approx([0.0, 0.0, -STIFFNESS_N_M * 1e-4, 0.0, 0.0, 0.0], abs=1e-4)


def test_finer_steps_change_nothing_and_the_same_push_is_the_same() -> None:
    """To 5 mN at 20 N; and to the last bit when repeated."""
    rotation, translation, motion = before_the_hole(30, 0.05, 0.002, 2)
    arguments = (TABLES, SURFACES, rotation, translation, motion, 3e-4, COMPLIANCE, 0.1)
    coarse, fine = push(*arguments), push(*arguments, PushSettings(steps=96))
    assert np.abs(coarse.wrench_peg - fine.wrench_peg).max() < 5e-3
    assert np.array_equal(coarse.wrench_peg, push(*arguments).wrench_peg)


def test_a_push_into_nothing_feels_nothing() -> None:
    """Away from the plate."""
    rotation, translation, motion = before_the_hole(4, 0.05, 0.002, 3)
    found = push(TABLES, SURFACES, rotation, translation, -motion, 3e-4, COMPLIANCE, 0.1)
    assert np.all(np.isinf(found.travel_m)) and np.all(found.wrench_peg == 0.0)


def test_thirty_pushes_agree_with_the_engine() -> None:
    """Single and several contacts, with friction and without, stiff and soft wrist, five shapes.

    Against the hulls that the engine really holds: hundredths of a degree and tens of nanometres. Against the drawing:
    what the engine's grid of some micrometres costs.
    """
    found = [one for one in agreements(range(30)) if one.unsteady_n < 0.02]
    assert len(found) >= 26
    assert np.median([one.snapped.direction_deg for one in found]) < 0.05
    assert np.median([one.snapped.moment_nm for one in found]) < 1e-3
    assert np.median([one.snapped.place_m for one in found]) < 2e-7
    assert np.quantile([one.snapped.direction_deg for one in found], 0.9) < 0.5
    assert np.quantile([one.drawn.direction_deg for one in found], 0.9) < 1.0
    assert np.quantile([one.drawn.moment_nm for one in found], 0.9) < 0.03
    assert max(one.drawn.place_m for one in found) < 2.5e-5
    smooth = [one for one in found if one.case.friction == 0.0 and one.snapped.contacts == 1]
    assert len(smooth) >= 8
    assert max(one.snapped.direction_deg for one in smooth) < 0.01
    assert max(one.snapped.moment_nm for one in smooth) < 1e-3
