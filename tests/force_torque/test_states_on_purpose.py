"""Contact states made on purpose: labels from contact points, aimed pushes, and some of them in the real cell."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from typing import cast

import numpy as np
import pytest
from rich.console import Console

from crosspih_common.bus import Bus
from crosspih_common.config import Workcell
from crosspih_common.contacts import ArmEdges
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import CLASSIFY, RESET
from crosspih_common.messages import ClassifyContacts, ContactClassifier, ResetCell, SimulationTruth
from crosspih_common.shapes import CrossPeg
from services.operator.assembly.payload import ready_arm
from services.operator.assembly.session import Session
from services.operator.bench.contact_states.aiming import pattern_of, predict_pushes
from services.operator.bench.contact_states.collecting import Contact, stiffness_condition
from services.operator.bench.contact_states.judged import Judged, StateVerdict
from services.operator.bench.contact_states.labels import label_contacts
from services.operator.bench.contact_states.plan import (
    AHEAD_M,
    STATE_NAMES,
    Plan,
    arms_aimed_at,
    arms_of,
    joints_at_hole,
    lateral_stiffness_n_m,
    make_plan,
)
from services.operator.bench.contact_states.pushing import PushResult, PushTask, make_push
from services.operator.bench.contact_states.summary import NAMES, confusion, reliability, summarise
from services.operator.bench.contact_states.tables import print_tables
from tests.planning.cell_in_memory import CellInMemory

AXES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
TAPER_START_M = CrossPeg().taper_start_m


def on_taper(arm: int, sense: int, force_n: float = 10.0) -> tuple[Array, Array]:
    sideways = np.cross([0.0, 0.0, 1.0], AXES[arm - 1]) * (1.0 if sense == 2 else -1.0)
    return 0.018 * AXES[arm - 1] + [0.0, 0.0, 0.062], force_n * (sideways - [0.0, 0.0, 0.3])


def labelled(*contacts: tuple[Array, Array]) -> tuple[str, str]:
    points, forces = (np.array(column) for column in zip(*contacts, strict=True))
    state = label_contacts(points, forces, TAPER_START_M)
    return state.name, state.reason


@pytest.mark.parametrize("name", STATE_NAMES)
def test_contact_points_of_each_state_have_its_name(name: str) -> None:
    arms, sense = arms_of(name)
    assert labelled(*(on_taper(arm, sense) for arm in arms)) == (name, "")


def test_what_is_none_of_the_26_says_what_it_is() -> None:
    assert labelled(on_taper(1, 1), on_taper(3, 1)) == ("none", "opposite arms")
    assert labelled(on_taper(1, 1), on_taper(2, 2)) == ("none", "walls of both senses")
    end = (np.array([0.02, 0.0, 0.06]), np.array([-8.0, 0.0, -6.0]))
    assert labelled(end) == ("none", "end of an arm")
    face = (np.array([0.005, 0.001, 0.0797]), np.array([0.2, 0.1, -9.0]))
    assert labelled(on_taper(1, 1), face) == ("none", "face or chamfer")
    body = (np.array([0.026, 0.009, 0.05]), np.array([0.0, -8.0, 0.4]))
    assert labelled(body) == ("none", "the body touches")
    assert label_contacts(np.zeros((0, 3)), np.zeros((0, 3)), TAPER_START_M).reason == "nothing touches"


def test_a_contact_that_carries_next_to_nothing_does_not_count() -> None:
    assert labelled(on_taper(1, 1, 20.0), on_taper(2, 1, 0.3))[0] == "1-1-1"
    assert labelled(on_taper(1, 1, 20.0), on_taper(2, 1, 2.0))[0] == "2-1-1"


def test_the_wrist_is_made_as_stiff_as_asked() -> None:
    for wanted in (20.0, 200.0):
        condition = stiffness_condition(Workcell(), wanted)
        made = Workcell.model_validate(condition.overrides["cell"])
        assert lateral_stiffness_n_m(made) == pytest.approx(wanted * 1e3, rel=1e-3)
    assert stiffness_condition(Workcell(), 0.0).overrides == {}


@pytest.fixture(scope="module")
def plan() -> Plan:
    return make_plan(Workcell(), 0.1, 0.0, each=2, random=3, seed=4)


def test_every_state_is_aimed_at_and_by_the_seed_alone(plan: Plan) -> None:
    assert {name: len(plan.pushes[name]) for name in STATE_NAMES} == dict.fromkeys(STATE_NAMES, 2)
    assert plan == make_plan(Workcell(), 0.1, 0.0, each=2, random=3, seed=4)
    # by itself nearly every push touches with one arm
    single = sum(share for name, share in plan.share.items() if name.startswith("1-"))
    assert 0.8 < single < 1.0
    assert sum(plan.share.values()) == pytest.approx(1.0)
    by_arms = arms_aimed_at(plan)
    assert by_arms[0] == pytest.approx(single) and sum(by_arms) == pytest.approx(1.0)


def test_a_centred_turned_peg_presses_with_all_four_arms() -> None:
    workcell = Workcell()
    peg = workcell.peg.shape()
    edges = ArmEdges.of(peg, workcell.hole.shape(peg))
    compliance = workcell.compliance_peg(joints_at_hole(workcell))
    angles = np.array([[0.05, 0.0, 0.0], [-0.05, 0.0, 0.0], [0.05, 0.0, 0.0]])
    lateral = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.003]])
    aimed = predict_pushes(edges, compliance, 0.1, angles, lateral, np.full(3, 10.0), AHEAD_M)
    assert aimed.pattern().tolist()[:2] == [pattern_of((1, 2, 3, 4), 2), pattern_of((1, 2, 3, 4), 1)]
    # the peg stands towards +y: arm 3 is pushed along -y
    assert aimed.pattern().tolist()[2] == pattern_of((3,), 2)


@dataclass
class InMemorySession:
    """What a push needs of a session, on the real cell in memory."""

    bus: Bus

    def new_trial(self, command: ResetCell) -> SimulationTruth:
        return self.bus.call(RESET, command, 30.0)

    def __hash__(self) -> int:
        return id(self)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    cell = CellInMemory(tmp_path_factory.mktemp("cell"), with_inference=False)
    try:
        yield cast(Session, InMemorySession(cell.bus))
    finally:
        cell.close()


def test_aimed_pushes_come_about_in_the_cell_and_are_judged_over_the_bus(session: Session, plan: Plan) -> None:
    hits = 0
    results = []
    states = ("1-1-2", "2-2-3", "4-1-1")
    with ready_arm(session, "a test") as lease:
        tasks = [PushTask(target=name, index=0, seed=9, push=plan.pushes[name][0]) for name in states]
        pushed = [make_push(session, lease, task) for task in tasks]
    for name, result in zip(states, pushed, strict=True):
        assert result.failure is None
        rows = np.array(result.contacts)
        hits += label_contacts(rows[:, :3], rows[:, 3:], TAPER_START_M).name == name
        # the sensor's wrench is that of the contact points
        moment = np.cross(rows[:, :3], rows[:, 3:]).sum(axis=0)
        assert np.array(result.wrench) == pytest.approx([*rows[:, 3:].sum(axis=0), *moment], abs=0.6)
        results.append(result)
    assert hits >= 2
    for classifier in ContactClassifier:
        judged = session.bus.call(
            CLASSIFY,
            ClassifyContacts(
                wrenches=tuple(result.wrench for result in results),
                wrench_sds=tuple(result.wrench_sd for result in results),
                classifier=classifier,
            ),
            30.0,
        )
        assert [state.classifier for state in judged.states] == [classifier] * 3
        assert judged.states[0].case == "1-1-2"


def test_the_summary_counts_what_was_judged() -> None:
    def judged(name: str, rule: str, likelihood: str, confidence: float) -> Judged:
        arms, sense = arms_of(name)
        rows = [np.concatenate(on_taper(arm, sense)) for arm in arms]
        truth = label_contacts(np.array(rows)[:, :3], np.array(rows)[:, 3:], TAPER_START_M)
        force = np.array(rows)[:, 3:].sum(axis=0)
        result = PushResult(target=name, index=0, wrench=(*force, 0.0, 0.0, 0.0))
        said = {
            ContactClassifier.RULE: StateVerdict(rule, confidence, "n_z0 = 0.5 lies outside"),
            ContactClassifier.LIKELIHOOD: StateVerdict(likelihood, confidence, ""),
        }
        return Judged(Contact(0.0, result, truth), said)

    each = [judged(name, name, name, 0.95) for name in STATE_NAMES]
    each += [judged("2-1-1", "none", "2-1-1", 0.95), judged("3-1-1", "1-1-3", "3-1-2", 0.55)]
    figures = summarise(each)
    assert figures["contacts"] == 28
    assert figures["on_purpose"]["rule"]["right"] == 26
    assert figures["on_purpose"]["likelihood"]["right"] == 27
    assert figures["rule_wrong"] == {
        "none: n_z0 outside its band, forces about equal": 1,
        "the count wrong, forces about equal": 1,
    }
    assert figures["threes"] == {"wrong": 1, "another_three_or_four_of_the_same_sense": 1}
    assert list(figures["n_z0_median"]["0"]) == ["1", "2", "3", "4"]
    console = Console(width=120, record=True, file=io.StringIO())
    print_tables({**figures, "by_geometry": {"0": [0.96, 0.04, 0.0, 0.0, 0.0]}}, console)
    assert "names wrong: 1, of them as another three" in console.export_text()
    counts = confusion(each, ContactClassifier.LIKELIHOOD)
    assert counts[NAMES.index("3-1-1"), NAMES.index("3-1-2")] == 1
    assert np.trace(counts) == 27
    assert [row["of"] for row in reliability(each, ContactClassifier.LIKELIHOOD)] == [1, 27]
