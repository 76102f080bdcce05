"""The strategies that fused is compared with, in the real cell with played vision, and their geometry by itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose, wrench_of_force_at_point
from crosspih_common.keys import ASSEMBLE
from crosspih_common.messages import Assemble, AssemblyResult, ContactState, Failure, PoseData, Strategy, Touch, floats
from services.hardware.control.search_path import SearchPath
from services.operator.scoring.score import insertion_depth_m
from services.planning.strategies import STRATEGIES
from services.planning.strategies.clearances import sideways_room_m
from services.planning.strategies.face_touches import on_the_face, where_the_tip_touches
from services.planning.strategies.search_push import SEARCH_S
from services.planning.strategies.spiral import SETTLE_S, archimedean
from services.planning.strategies.tilt import SPEED_RAD_S, random_tilts
from tests.planning.cell_in_memory import CellInMemory

NOMINAL = Workcell().hole_prior.pose_base_hole()
POOR = 15.0  # times the played vision's error: 0.75 mm and 2.6 deg, one sd


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CellInMemory]:
    opened = CellInMemory(tmp_path_factory.mktemp("cell"))
    yield opened
    opened.close()


def assembled(cell: CellInMemory, strategy: Strategy, vision_scale: float | None, **place: Any) -> AssemblyResult:
    cell.vision_scale = vision_scale
    cell.reset(1, **place)
    return cell.bus.call(ASSEMBLE, Assemble(strategy=strategy, assembly_id="test"), 200.0)


def test_every_strategy_has_its_function() -> None:
    assert set(STRATEGIES) == set(Strategy)


def test_good_vision_needs_no_yielding(cell: CellInMemory) -> None:
    result = assembled(cell, Strategy.STRAIGHT, 0.3)
    assert result.inserted and result.touches == 0 and result.pushes == 1
    truth = cell.truth()
    depth_m = insertion_depth_m(cell.cell.workcell, truth.pose_base_peg.pose(), truth.pose_base_hole.pose())
    assert depth_m > cell.cell.workcell.insertion_depth_m


@pytest.mark.parametrize(
    ("strategy", "failure"), [(Strategy.STRAIGHT, Failure.NOT_CONVERGED), (Strategy.VISION_ONLY, Failure.OVERLOAD)]
)
def test_poor_vision_defeats_what_does_not_yield(cell: CellInMemory, strategy: Strategy, failure: Failure) -> None:
    result = assembled(cell, strategy, POOR)
    assert result.failure is failure and result.backed_off
    assert np.linalg.norm(cell.truth().wrench_contact) == 0.0


def test_a_spiral_finds_what_nobody_saw(cell: CellInMemory) -> None:
    """The tip lands on the face beside the hole; three touches gave its plane, the spiral gives the rest."""
    result = assembled(cell, Strategy.SPIRAL, None, offset_hole=(0.007, -0.005, -0.013, 0.03, -0.02, 0.04))
    assert result.inserted and result.vision_pose_base_hole is None
    assert result.touches > 3, "the spiral was not needed: put the hole elsewhere"
    assert result.contact_s > 0.0 and result.contact_impulse_n_s / result.contact_s < result.peak_force_n
    assert 0.3 < result.tip_path_m < 10.0


@settings(max_examples=25, deadline=None)
@given(st.floats(0.002, 0.02), st.floats(0.001, 0.01), st.booleans())
def test_a_spiral_passes_no_place_by(radius_m: float, pitch_m: float, clockwise: bool) -> None:
    knots = archimedean(radius_m, pitch_m, 0.01, clockwise)
    places = np.array([knot.offset_m for knot in knots])
    times = np.array([knot.time_s for knot in knots])
    assert np.all(np.diff(times) > 0.0) and times[0] == SETTLE_S
    distances = np.linalg.norm(places, axis=1)
    assert distances[-1] >= radius_m - 1e-9
    assert np.all(np.diff(distances) > 0.0)
    angles = np.unwrap(np.arctan2(places[1:, 1], places[1:, 0]))
    assert np.allclose(np.diff(distances[1:]), np.abs(np.diff(angles)) * pitch_m / (2.0 * np.pi), atol=1e-9)
    assert np.all(np.diff(angles) < 0.0) == clockwise
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(times)
    assert speeds.max() <= 1.001 * max(0.01, np.linalg.norm(np.diff(places, axis=0), axis=1).sum() / 50.0)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.002, 0.015), st.floats(2e-5, 1e-3))
def test_a_fine_spiral_is_a_path_that_the_arm_takes(radius_m: float, pitch_m: float) -> None:
    """Its innermost turns are shorter than a step of the arm."""
    knots = archimedean(radius_m, pitch_m, 0.008)
    search = SearchPath(knots, np.eye(3), np.array([0.0, 0.0, 1.0]), 0.001)
    assert search.fastest_m_s <= 1.01 * max(0.008, np.pi * (radius_m + pitch_m) ** 2 / pitch_m / (SEARCH_S - SETTLE_S))
    assert np.linalg.norm(knots[-1].offset_m) >= radius_m - 1e-9


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 0.1))
def test_tilts_keep_inside_what_may_be_off(seed: int, reach_rad: float) -> None:
    knots = random_tilts(np.random.default_rng(seed), np.array([reach_rad, reach_rad, 0.5 * reach_rad]))
    turns = np.array([knot.turn_rad for knot in knots])
    assert np.all(np.abs(turns) <= [reach_rad, reach_rad, 0.5 * reach_rad])
    speeds = np.linalg.norm(np.diff(turns, axis=0), axis=1) / np.diff([knot.time_s for knot in knots])
    assert speeds.max() <= SPEED_RAD_S * 1.001
    assert knots == random_tilts(np.random.default_rng(seed), np.array([reach_rad, reach_rad, 0.5 * reach_rad]))


def test_the_tip_has_six_millimetres_of_room_and_the_body_its_clearance() -> None:
    """The paper's peg: half-width 9 mm, 2.5 mm at the tip, in a hole of 9.1 mm."""
    workcell = Workcell()
    peg = workcell.peg.shape()
    assert sideways_room_m(workcell, 0.0) == pytest.approx(0.0091 - 0.0025, abs=1e-6)
    assert sideways_room_m(workcell, peg.taper_length_m + 0.001) == pytest.approx(0.0001, abs=1e-9)
    assert sideways_room_m(workcell, 0.011) == pytest.approx(0.0091 - 0.0025 - 0.25 * 0.010, abs=1e-6)


@settings(deadline=None)
@given(
    st.tuples(*[st.floats(-0.1, 0.1)] * 2),
    st.floats(-0.015, 0.015),
    st.tuples(*[st.floats(-0.01, 0.01)] * 2),
)
def test_three_points_give_the_face(
    tilt_rad: tuple[float, float], depth_m: float, lateral: tuple[float, float]
) -> None:
    face = NOMINAL @ Pose.from_translation([0.0, 0.0, depth_m]) @ Pose.from_rotvec([*tilt_rad, 0.0], np.zeros(3))
    points = face.apply([[0.04, 0.04, 0.0], [-0.04, 0.04, 0.0], [*lateral, 0.0]])
    found = on_the_face(NOMINAL, points)
    assert np.allclose(found.translation_m, face.translation_m, atol=1e-12)
    assert np.allclose(found.rotation[:, 2], face.rotation[:, 2], atol=1e-12)
    turned = np.arccos(np.clip(face.rotation[:, 2] @ NOMINAL.rotation[:, 2], -1.0, 1.0))
    assert found.angle_to_rad(NOMINAL) == pytest.approx(float(turned), abs=1e-6)


@settings(deadline=None)
@given(st.tuples(*[st.floats(-0.007, 0.007)] * 2), st.floats(-1.0, 1.0), st.floats(2.0, 20.0))
def test_the_line_of_action_meets_the_tip_where_it_touched(
    place: tuple[float, float], friction_n: float, force_n: float
) -> None:
    tip_m = Workcell().peg.shape().tip_m
    point = np.array([*place, tip_m])
    wrench = wrench_of_force_at_point(np.array([friction_n, -friction_n, -force_n]), point)
    touch = Touch(
        index=0,
        pose_base_peg=PoseData.of(NOMINAL),
        direction_base=(0.0, 0.0, 1.0),
        joints_rad=(0.0,) * 6,
        wrench=floats(wrench),
        wrench_sd=(0.1,) * 6,
        state=ContactState(case=None, confidence=0.0, reason="", n_z0=1.0),
    )
    assert np.allclose(where_the_tip_touches(touch, tip_m), point, atol=1e-9)
