"""The likelihood over sets of touching edges: geometry, the paper's contacts, contacts of known sets, and doubt."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.contacts import ArmEdges, edge_index, sliding_wrench
from crosspih_common.geometry import rotation_from_error_angles, wrench_of_force_at_point
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import ContactClassifier
from crosspih_common.shapes import CrossPeg
from services.force_torque.contact_likelihood import LikelihoodClassifier
from services.force_torque.contact_sets import NO_STATE, all_edge_sets
from services.force_torque.contact_table import STATES
from services.force_torque.judging import Judge
from services.inference.mechanics import PairTables, contact_geometry, contact_wrench_basis, first_contacts
from tests.paper_tables import FIRST_CONTACT, TABLE_6

SD = np.repeat([0.02, 0.001], 3)
Z = np.array([0.0, 0.0, 1.0])
PEG = CrossPeg()
HOLE = PEG.hole(0.0001)


@pytest.fixture(scope="module")
def classifier() -> LikelihoodClassifier:
    return LikelihoodClassifier.of(Workcell())


@pytest.fixture(scope="module")
def compliance() -> Array:
    return Workcell().compliance_peg(Workcell().home_joints_rad)


def at_first_contact(edges: ArmEdges, angles: Array, lateral: Array) -> tuple[Array, Array]:
    """rotation_hole_peg and translation (m) of a peg driven along its axis until the first edge meets its rim."""
    rotation = rotation_from_error_angles(angles).T
    start = np.array([*lateral, 0.0]) - rotation[:, 2] * 0.1
    before = edges.at(rotation, start)
    travel = before.gap_m / -(before.normal_peg @ Z)
    places = start + travel[:, None] * rotation[:, 2]
    within = edges.at(np.broadcast_to(rotation, (8, 3, 3)), places).on_both.diagonal()
    return rotation, places[int(np.argmin(np.where(within, travel, np.inf)))]


def test_the_sets_are_the_26_states_and_other_pairs_and_threes() -> None:
    sets = all_edge_sets()
    assert (sets.state >= 0).sum() == 26
    assert [int(count) for count in np.bincount(sets.count[sets.state == NO_STATE], minlength=4)] == [0, 0, 16, 24]
    for row, edges, used in zip(STATES, sets.edges, sets.used, strict=False):
        assert sorted(edges[used].tolist()) == sorted(edge_index(arm, row.sense) for arm in row.arms)


def test_edges_touch_where_the_mechanics_says() -> None:
    edges, tables = ArmEdges.of(PEG, HOLE), PairTables.of(PEG, HOLE)
    rng = np.random.default_rng(0)
    agree = 0
    for _ in range(20):
        rotation, place = at_first_contact(edges, rng.uniform(-0.08, 0.08, 3), rng.uniform(-0.002, 0.002, 2))
        motion = rotation @ Z
        contacts = first_contacts(tables, rotation[None], (place - 0.001 * motion)[None], motion[None])
        first = int(np.argmin(contacts.travel_m[0]))
        found = contact_geometry(contacts.features[0, first], rotation, place)
        mine = edges.at(rotation, place)
        touching = int(np.argmin(np.abs(mine.gap_m) + ~mine.on_both))
        if contacts.travel_m[0, first] == pytest.approx(0.001, abs=1e-8):
            agree += 1
            assert mine.normal_peg[touching] == pytest.approx(found.normal_peg, abs=1e-6)
            assert mine.point_peg_m[touching] == pytest.approx(found.point_peg_m, abs=1e-6)
    assert agree >= 18


def test_sliding_friction_is_that_of_the_mechanics(compliance: Array) -> None:
    edges = ArmEdges.of(PEG, HOLE)
    rotation, place = at_first_contact(edges, np.array([0.05, 0.02, -0.01]), np.zeros(2))
    contact = edges.at(rotation, place)
    mine = sliding_wrench(contact.normal_peg, contact.point_peg_m, np.full(8, 0.1), compliance, Z)
    theirs = contact_wrench_basis(contact.normal_peg, contact.point_peg_m, np.tile(Z, (8, 1)), 0.1, compliance)
    assert mine == pytest.approx(theirs, abs=1e-9)


@pytest.mark.parametrize("wrench", [FIRST_CONTACT, *TABLE_6])
def test_the_papers_contacts_are_1_2_2(wrench: list[float], compliance: Array) -> None:
    frictionless = LikelihoodClassifier(PEG, HOLE, compliance, 0.0)
    # printed to 1e-3 N and Nm, a peg whose taper is 0.5 % steeper than ours
    found = frictionless.classify(wrench, np.repeat([0.05, 0.005], 3))
    assert found.name == "1-2-2"
    assert found.confidence > 0.6


@pytest.mark.parametrize("row", [row for row in STATES if row.count == 1], ids=lambda row: row.name)
def test_one_edge_is_told_whatever_the_error(row: object, classifier: LikelihoodClassifier, compliance: Array) -> None:
    edges = ArmEdges.of(PEG, HOLE)
    rng = np.random.default_rng(5)
    told = tried = 0
    while tried < 6:
        rotation, place = at_first_contact(edges, rng.uniform(-0.1, 0.1, 3), rng.uniform(-0.004, 0.004, 2))
        contact = edges.at(rotation, place)
        edge = int(np.argmin(np.abs(contact.gap_m) + ~contact.on_both))
        state = next(state for state in STATES if state.count == 1 and edge_index(state.arms[0], state.sense) == edge)
        if state is not row:
            continue
        tried += 1
        basis = sliding_wrench(contact.normal_peg, contact.point_peg_m, np.full(8, 0.1), compliance, Z)[edge]
        found = classifier.classify(12.0 * basis + rng.normal(size=6) * SD, SD)
        assert found.state in (state, None)
        told += found.state is state
    assert told >= 5


@pytest.mark.parametrize("row", [row for row in STATES if row.count in (2, 4)], ids=lambda row: row.name)
def test_centred_and_turned_several_edges_press_together(
    row: object, classifier: LikelihoodClassifier, compliance: Array
) -> None:
    state = next(state for state in STATES if state is row)
    edges = ArmEdges.of(PEG, HOLE)
    yaw = 0.05 * (1.0 if state.sense == 2 else -1.0)
    rotation, place = at_first_contact(edges, np.array([yaw, 0.0, 0.0]), np.zeros(2))
    contact = edges.at(rotation, place)
    pressed = [edge_index(arm, state.sense) for arm in state.arms]
    assert contact.gap_m[pressed] == pytest.approx(0.0, abs=1e-7)
    basis = sliding_wrench(contact.normal_peg, contact.point_peg_m, np.full(8, 0.1), compliance, Z)[pressed]
    found = classifier.classify(np.linspace(9.0, 6.0, state.count) @ basis, SD)
    best = {found.state, found.runner_up}
    assert state in best
    if state.count == 2:
        assert found.state is state


def test_what_no_taper_edge_makes_is_none() -> None:
    classifier = LikelihoodClassifier.of(Workcell())
    face = wrench_of_force_at_point([0.3, 0.0, -15.0], [0.004, 0.006, PEG.tip_m])
    end = wrench_of_force_at_point([-10.0, 0.4, -9.0], [0.02, 0.001, 0.06])
    for wrench in (face, end):
        found = classifier.classify(wrench, SD)
        assert found.state is None
        assert "no set of taper edges" in found.reason
    assert "no contact" in classifier.classify([0.1, 0.0, -0.1, 0.0, 0.0, 0.0], SD).reason
    assert "does not push" in classifier.classify([5.0, 0.0, 2.0, 0.0, 0.3, 0.0], SD).reason
    with pytest.raises(ValueError, match="six finite"):
        classifier.classify([1.0] * 5, SD)


def test_the_same_wrench_is_judged_the_same_to_the_last_bit(classifier: LikelihoodClassifier) -> None:
    first, again = (classifier.classify(FIRST_CONTACT, SD) for _ in range(2))
    assert first == again


def test_another_peg_than_the_cross_is_judged_by_the_rule() -> None:
    square = Workcell.model_validate({"peg": {"outline": "square"}})
    with pytest.raises(ValueError, match="those of a cross"):
        LikelihoodClassifier.of(square)
    judged = Judge(square, ContactClassifier.LIKELIHOOD)(FIRST_CONTACT)
    assert judged.classifier is ContactClassifier.RULE


def test_either_classifier_can_be_asked_for() -> None:
    judge = Judge(Workcell(friction_expected=0.0), ContactClassifier.LIKELIHOOD)
    sd = np.repeat([0.05, 0.005], 3)
    by_default, by_rule = judge(FIRST_CONTACT, sd), judge(FIRST_CONTACT, sd, ContactClassifier.RULE)
    assert by_default.classifier is ContactClassifier.LIKELIHOOD
    assert by_rule.classifier is ContactClassifier.RULE
    assert by_default.case == by_rule.case == "1-2-2"
