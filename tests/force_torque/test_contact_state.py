"""The 26 contact states: Tables 2-5 from their one rule, the paper's own contacts, and contacts of the shape itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.geometry import rotation_from_error_angles, wrench_of_force_at_point
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import CrossPeg
from services.force_torque.contact_state import (
    COUNT_BANDS,
    ClassifierSettings,
    classify_contact,
    contact_height_m,
    count_bands,
)
from services.force_torque.contact_table import STATES, StateRow, signs_text, touching_arms
from tests.paper_tables import FIRST_CONTACT, TABLE_6

AXES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
Z = np.array([0.0, 0.0, 1.0])
AXIAL_SHARE = 0.2894  # from the printed n_z0 of one contact, .278


def pushed(arm: int, sense: int) -> Array:
    """The rule's lateral direction on an arm: -(z x u) for sense 1, +(z x u) for sense 2."""
    return (1.0 if sense == 2 else -1.0) * np.cross(Z, AXES[arm - 1])


def equal_pushes(row: StateRow, force_n: float = 10.0) -> Array:
    wrench = np.zeros(6)
    for arm in row.arms:
        force = force_n * (pushed(arm, row.sense) - AXIAL_SHARE * Z)
        wrench += wrench_of_force_at_point(force, 0.0176 * AXES[arm - 1] + 0.065 * Z)
    return wrench


def test_there_are_26_states_and_18_sign_patterns() -> None:
    assert len(STATES) == 26
    assert len({row.name for row in STATES}) == 26
    assert len({row.signs for row in STATES}) == 18
    assert [sum(row.count == count for row in STATES) for count in (1, 2, 3, 4)] == [8, 8, 8, 2]


@pytest.mark.parametrize("row", STATES, ids=lambda row: row.name)
def test_tables_2_to_5_follow_from_the_one_rule(row: StateRow) -> None:
    lateral = sum((pushed(arm, row.sense) for arm in row.arms), np.zeros(3))
    moment = np.cross(0.065 * Z, lateral)  # the small y Fz and x Fz parts left out, as printed
    yaw = sum((np.cross(AXES[arm - 1], pushed(arm, row.sense)) for arm in row.arms), np.zeros(3))
    wrench = np.array([lateral[0], lateral[1], -1.0, moment[0], moment[1], yaw[2]])
    assert tuple(np.sign(np.round(wrench, 9)).astype(int)) == row.signs


@pytest.mark.parametrize(
    ("name", "signs"),
    [
        ("1-1-2", "+ 0 - 0 + -"),
        ("1-2-2", "- 0 - 0 - +"),
        ("2-2-2", "- - - + - +"),
        ("3-1-2", "- 0 - 0 - -"),
        ("3-2-4", "- 0 - 0 - +"),
        ("4-1-1", "0 0 - 0 0 -"),
    ],
)
def test_rows_as_printed(name: str, signs: str) -> None:
    assert [signs_text(row.signs) for row in STATES if row.name == name] == [signs]


def test_each_three_point_row_has_the_signs_of_a_one_point_row_of_the_same_sense() -> None:
    single = {(row.sense, row.signs) for row in STATES if row.count == 1}
    assert {(row.sense, row.signs) for row in STATES if row.count == 3} == single


def test_arms_of_a_case() -> None:
    assert touching_arms(1, 3) == (3,)
    assert touching_arms(2, 4) == (1, 4)
    assert touching_arms(3, 2) == (1, 3, 4)
    assert touching_arms(4, 1) == (1, 2, 3, 4)
    with pytest.raises(ValueError, match="no case 2 of 4"):
        touching_arms(4, 2)


def test_the_experiments_first_contact_is_1_2_2() -> None:
    found = classify_contact(FIRST_CONTACT)
    assert found.name == "1-2-2"
    assert found.confidence > 0.85
    assert found.n_z0 == pytest.approx(0.2697, abs=1e-4)
    assert contact_height_m(FIRST_CONTACT) == pytest.approx(0.0646, abs=2e-4)
    assert found.state is not None
    assert found.state.arms == (2,)


@pytest.mark.parametrize("wrench", TABLE_6)
def test_table_6_is_all_1_2_2(wrench: list[float]) -> None:
    found = classify_contact(wrench)
    assert found.name == "1-2-2"
    assert found.confidence > 0.45


@pytest.mark.parametrize("row", STATES, ids=lambda row: row.name)
def test_equal_pushes_show_their_state_and_the_printed_n_z0(row: StateRow) -> None:
    found = classify_contact(equal_pushes(row))
    assert found.state is row
    assert found.confidence > 0.75
    assert found.n_z0 == pytest.approx({1: 0.278, 2: 0.376, 3: 0.649, 4: 1.0}[row.count], abs=0.008)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.sampled_from(STATES), st.floats(3.0, 30.0), st.integers(0, 2**32 - 1))
def test_noise_costs_confidence_but_gives_no_other_state(row: StateRow, force: float, seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0.0, [0.1] * 3 + [0.005] * 3)
    found = classify_contact(equal_pushes(row, force) + noise)
    assert found.state is row or (found.state is None and found.reason)


def shape_contact(row: StateRow, friction: float, rng: np.random.Generator) -> Array:
    """Taper edges against the rim (force along M1N1 x D1D2), errors within 0.1 rad, unequal shares, any height.

    The peg is moving along +z, so that friction on each edge pulls back along the contact plane.
    """
    peg = CrossPeg()
    tips, bodies = peg.taper_edges_m()
    yaw = rng.uniform(0.0, 0.1) * (1 if row.sense == 2 else -1)
    rotation = rotation_from_error_angles([yaw, *rng.uniform(-0.1, 0.1, 2)])
    wrench = rng.normal(0.0, [0.02] * 3 + [0.001] * 3)
    for arm in row.arms:
        side = AXES[arm - 1] * peg.half_length_m - pushed(arm, row.sense) * peg.half_width_m
        corner = int(np.argmin(np.linalg.norm(bodies[:, :2] - side[:2], axis=1)))
        edge = bodies[corner] - tips[corner]
        normal = np.cross(edge, rotation @ AXES[arm - 1])
        normal *= np.sign(normal @ pushed(arm, row.sense)) / np.linalg.norm(normal)
        back = -Z + (Z @ normal) * normal
        force = 10.0 * rng.uniform(0.8, 1.2) * (normal + friction * back / np.linalg.norm(back))
        wrench = wrench + wrench_of_force_at_point(force, tips[corner] + rng.uniform(0.4, 0.95) * edge)
    return wrench


@pytest.mark.parametrize("friction", [0.0, 0.1])
def test_contacts_of_the_shape_itself_give_their_state_or_none_never_another(friction: float) -> None:
    rng = np.random.default_rng(0)
    known = ClassifierSettings(force_sd_n=0.02, moment_sd_nm=0.001, friction=friction)
    trials = 60
    right = {}
    for count in (1, 2, 3, 4):
        rows = [row for row in STATES if row.count == count]
        right[count] = 0
        for trial in range(trials):
            row = rows[trial % len(rows)]
            found = classify_contact(shape_contact(row, friction, rng), known)
            assert found.state in (row, None)
            right[count] += found.state is row
    assert min(right[1], right[2], right[4]) >= 0.95 * trials
    assert right[3] >= 0.75 * trials


def test_friction_moves_the_bands_and_left_out_it_is_a_none() -> None:
    row = next(row for row in STATES if row.name == "1-2-2")
    wrench = shape_contact(row, 0.2, np.random.default_rng(1))
    assert classify_contact(wrench, ClassifierSettings(friction=0.2)).state is row
    assert classify_contact(wrench).state is None
    assert count_bands(0.0) == COUNT_BANDS
    one, two, three, four = count_bands(0.1)
    # One push of n_z0 = .27 leans back by 15.7 degrees; friction of 0.1 adds 5.7.
    assert one.middle == pytest.approx(np.sin(np.arcsin(0.27) + np.arctan(0.1)))
    assert 0.27 < one.middle < two.middle < three.middle < four.middle == 1.0


def test_confidence_falls_to_one_half_at_the_edges_of_a_band_and_to_nothing_in_the_wide_gaps() -> None:
    for band in COUNT_BANDS[:3]:
        assert band.confidence(band.middle) == 1.0
        assert band.confidence(band.low) == pytest.approx(0.5)
        assert band.confidence(band.high) == pytest.approx(0.5)
    for gap in (0.1, 0.49, 0.8):
        assert max(float(band.confidence(gap)) for band in COUNT_BANDS) == 0.0
    assert max(float(band.confidence(0.32)) for band in COUNT_BANDS) == pytest.approx(0.389, abs=0.02)


@pytest.mark.parametrize(
    ("wrench", "reason"),
    [
        ([0.2, 0.0, -0.1, 0.0, 0.0, 0.0], "no contact"),
        ([-19.2, -0.8, 5.4, -0.04, -1.24, 0.34], "does not push the peg back"),
        ([0.0, 0.0, -20.0, 0.4, 0.3, 0.001], "Mz = 0.0010 Nm has no sign"),
        ([-19.2, -0.8, -5.4, 0.04, 1.24, 0.34], "lateral force and the lateral moment belong to different cases"),
        ([-19.2, -0.8, -11.2, -0.04, -1.24, 0.75], r"n_z0 = 0\.504 lies outside .* 1 \(0.23-0.31\) or 3 \(0.58-0.71\)"),
        ([-19.2, -0.8, -5.4, -0.04, -1.24, 0.1], "walls of both senses"),
        ([-4.0, -0.2, -1.1, -0.2, -3.0, 1.5], "binds"),
    ],
)
def test_none_of_these_says_why(wrench: list[float], reason: str) -> None:
    found = classify_contact(wrench)
    assert found.state is None
    assert found.name == "none"
    with pytest.raises(AssertionError, match=reason):
        raise AssertionError(found.reason)


def test_walls_of_both_senses_are_none_of_the_26() -> None:
    first, second = STATES[0], next(row for row in STATES if row.name == "1-2-2")
    for share in (0.4, 0.7, 1.0):
        assert classify_contact(equal_pushes(first) + share * equal_pushes(second)).state is None


def test_malformed_input_is_refused() -> None:
    with pytest.raises(ValueError, match="six finite"):
        classify_contact([1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="four rising lengths"):
        ClassifierSettings(height_m=(0.1, 0.05, 0.08, 0.1))
