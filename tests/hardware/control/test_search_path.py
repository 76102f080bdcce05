"""A path that is moved along while pushing, and what a motion tells of its cost."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.messages import (
    AdmittanceMove,
    MoveLinear,
    PathKnot,
    PoseData,
    ResetCell,
    SetPayload,
    StopReason,
    floats,
)
from services.hardware.config import HardwareConfig
from services.hardware.control.effort import smoothness
from services.hardware.control.search_path import SearchPath
from services.hardware.drivers.simulated.config import SimulatedSensorConfig
from services.hardware.drivers.simulated.engines.protocol import STEP_S
from services.hardware.hosting import HostedCell, open_cell

WORKCELL = Workcell()
offsets = st.tuples(*[st.floats(-0.01, 0.01)] * 3)
turns = st.tuples(*[st.floats(-0.1, 0.1)] * 3)


@pytest.fixture(scope="module")
def cell() -> Iterator[HostedCell]:
    opened = open_cell(WORKCELL, HardwareConfig(), realtime=False)
    ft = SimulatedSensorConfig()
    opened.arm.set_payload(
        SetPayload(
            bias=ft.bias, weight_n=9.81 * ft.payload_kg, centroid_ft_m=ft.payload_centroid_m,
            gravity_base=(0.0, 0.0, -1.0),
        )
    )  # fmt: skip
    yield opened
    opened.close()


@settings(max_examples=25, deadline=None)
@given(offsets, turns, turns, turns)
def test_the_speeds_add_up_to_the_last_knot(
    offset: tuple[float, float, float],
    turn: tuple[float, float, float],
    other: tuple[float, float, float],
    frame: tuple[float, float, float],
) -> None:
    rotation = Rotation.from_rotvec(frame).as_matrix()
    push = rotation @ np.array([0.0, 0.0, 1.0])
    knots = (PathKnot(time_s=0.1, turn_rad=other), PathKnot(time_s=0.25, offset_m=offset, turn_rad=turn))
    path = SearchPath(knots, rotation, push, STEP_S)
    assert path.steps == 250
    came = path.velocity_m_s.sum(axis=0) * STEP_S
    assert np.allclose(came, rotation @ [offset[0], offset[1], 0.0], atol=1e-12)
    assert np.allclose(path.velocity_m_s @ push, 0.0, atol=1e-12)
    turned = Rotation.identity()
    for speed in path.turn_rad_s:
        turned = Rotation.from_rotvec(speed * STEP_S) * turned
    assert np.allclose(turned.as_rotvec(), rotation @ turn, atol=1e-9)


def test_knots_that_do_not_rise_are_refused() -> None:
    with pytest.raises(CommandRefused, match="time_s must rise"):
        SearchPath((PathKnot(time_s=0.2), PathKnot(time_s=0.2)), np.eye(3), np.array([0.0, 0.0, 1.0]), STEP_S)


def test_a_search_in_free_air_goes_its_path_and_ends_with_it(cell: HostedCell) -> None:
    cell.simulation.reset(ResetCell(seed=1))
    start = WORKCELL.pose_base_peg(WORKCELL.home_joints_rad)
    command = AdmittanceMove(
        direction_base=floats(start.rotation[:, 2]),
        speed_m_s=1e-4,
        travel_m=0.01,
        lateral_damping_n_s_m=1e6,
        rotational_damping_nm_s_rad=1e6,
        path=(
            PathKnot(time_s=1.0, offset_m=(0.005, 0.0, 0.0)),
            PathKnot(time_s=2.0, offset_m=(0.005, 0.004, 0.0), turn_rad=(0.0, 0.02, 0.01)),
        ),
    )
    outcome = cell.arm.admittance_move(command)
    assert outcome.stop_reason is StopReason.COMPLETED
    assert outcome.duration_s == pytest.approx(2.0, abs=0.03)
    centre = np.asarray(command.centre_peg_m)
    moved = start.inverse() @ outcome.pose_base_peg.pose()
    assert np.allclose(moved.apply(centre) - centre, [0.005, 0.004, 2e-4], atol=2e-5)
    assert np.allclose(moved.rotvec_rad(), [0.0, 0.02, 0.01], atol=1e-4)


def test_a_motion_tells_how_far_and_how_smoothly_its_tip_went(cell: HostedCell) -> None:
    """A quintic from rest to rest over d in T: |jerk| = d / T^3 |60 - 360 x + 360 x^2|, 8 d / T^2 rounded up in all."""
    cell.simulation.reset(ResetCell(seed=1))
    start = WORKCELL.pose_base_peg(WORKCELL.home_joints_rad)
    goal = start @ Pose.from_translation([0.0, 0.0, 0.05])
    outcome = cell.arm.move_linear(MoveLinear(pose_base_peg=PoseData.of(goal), speed_m_s=0.05))
    assert outcome.tip_path_m == pytest.approx(0.05, abs=1e-4)
    duration_s = 1.875 * 0.05 / 0.05
    x = np.linspace(0.0, 1.0, 2001)
    speed = 0.05 / duration_s * 30.0 * x**2 * (1.0 - x) ** 2
    jerk = 0.05 / duration_s**3 * np.abs(60.0 - 360.0 * x + 360.0 * x**2)
    moving = speed > 0.01
    assert outcome.moving_s == pytest.approx(duration_s * moving.mean(), abs=0.01)
    assert outcome.jerk_integral_m_s2 == pytest.approx(duration_s * np.mean(jerk * moving), rel=0.03)
    assert outcome.over_20_n_s == 0.0


def test_short_and_still_motions_have_no_jerk() -> None:
    assert smoothness(np.zeros((5, 3)), 0.002) == (0.0, 0.0)
    assert smoothness(np.zeros((100, 3)), 0.002) == (0.0, 0.0)
