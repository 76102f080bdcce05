"""What was seen against what was felt: known answers, what must not depend on the frame, and whole assemblies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Failure
from services.hardware.drivers.simulated.config import SimulatedConfig, TruthConfig
from services.operator.assembly.show import summary
from services.operator.scoring.score import score
from services.planning.contradiction import BOUND, contradiction, nearest_turn, squared_distance
from tests.planning.cell_in_memory import CellInMemory

SD = np.array([4e-5, 4e-5, 1e-4, 5e-3, 5e-3, 1e-3])
SEEN, FOUND = np.diag(SD**2), np.diag((0.1 * SD) ** 2)
HOLE = Pose.from_rotvec([0.3, -0.2, 1.1], [0.4, -0.3, 0.2])

rotvecs = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
across = st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))


def off_by(x: float, y: float, rx: float, ry: float, z: float = 0.0, rz: float = 0.0) -> Pose:
    return HOLE @ Pose(Pose.from_rotvec([rx, ry, rz], [0.0, 0.0, 0.0]).rotation, np.array([x, y, z]))


def covariance() -> Array:
    """Of a pose seen as one sees, its x bound up with its tilt about y."""
    found = SEEN.copy()
    found[0, 4] = found[4, 0] = 0.5 * SD[0] * SD[4]
    return found


def test_the_bound_is_that_of_four_directions() -> None:
    assert pytest.approx(18.4668, abs=1e-3) == BOUND


def test_known_answers() -> None:
    zero = np.zeros((6, 6))
    squared, difference, sd = squared_distance(HOLE, SEEN, off_by(2 * SD[0], 0, 0, -3 * SD[4]), zero, 4)
    assert squared == pytest.approx(4.0 + 9.0, rel=1e-6)
    assert difference == pytest.approx([2 * SD[0], 0.0, 0.0, -3 * SD[4]], abs=1e-12)
    assert sd == pytest.approx(SD[[0, 1, 3, 4]])
    # covariances add: twice the same covariance halves the square
    assert squared_distance(HOLE, SEEN, off_by(2 * SD[0], 0, 0, 0), SEEN, 4)[0] == pytest.approx(2.0)
    # depth, and the turn about the axis, do not count
    assert squared_distance(HOLE, SEEN, off_by(0, 0, 0, 0, z=0.02, rz=0.1), FOUND, 4)[0] == pytest.approx(0.0, abs=1e-9)
    # bound up with each other: along the correlation less is said than against it
    along = squared_distance(HOLE, covariance(), off_by(SD[0], 0, 0, SD[4]), zero, 4)[0]
    assert along == pytest.approx(2.0 / 1.5)
    assert squared_distance(HOLE, covariance(), off_by(SD[0], 0, 0, -SD[4]), zero, 4)[0] == pytest.approx(2.0 / 0.5)


@given(across)
def test_a_warning_exactly_beyond_the_bound(sds: tuple[float, ...]) -> None:
    pose = off_by(*(value * sd for value, sd in zip(sds, SD[[0, 1, 3, 4]], strict=True)))
    said = contradiction(HOLE, SEEN, pose, np.zeros((6, 6)), 4)
    squared = float(np.sum(np.square(sds)))
    if abs(squared - BOUND) > 0.01:
        assert (said is not None) == (squared > BOUND)


@given(rotvecs, st.integers(0, 3), across)
def test_neither_the_base_nor_a_quarter_turn_of_the_cross_matters(
    turn: tuple[float, ...], quarters: int, sds: tuple[float, ...]
) -> None:
    pose = off_by(*(value * sd for value, sd in zip(sds, SD[[0, 1, 3, 4]], strict=True)))
    base, quarter = Pose.from_rotvec(turn, [1.0, 2.0, 3.0]), Pose.from_rotvec([0.0, 0.0, quarters * np.pi / 2], [0] * 3)
    here = squared_distance(HOLE, covariance(), pose, FOUND, 4)[0]
    there = squared_distance(base @ HOLE, covariance(), base @ pose @ quarter, FOUND, 4)[0]
    assert there == pytest.approx(here, rel=1e-3, abs=1e-6)


@given(st.floats(-3.1, 3.1), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_a_round_peg_may_be_turned_anyhow(turn: float, rx: float, ry: float) -> None:
    tilted = Pose.from_rotvec([rx, ry, 0.0], [0.0, 0.0, 0.0])
    turned = nearest_turn(tilted @ Pose.from_rotvec([0.0, 0.0, turn], [0.0, 0.0, 0.0]), 0)
    assert turned.rotvec_rad() == pytest.approx([rx, ry, 0.0], abs=1e-6)


def test_the_text_says_how_far_and_what_to_look_at() -> None:
    said = contradiction(HOLE, SEEN, off_by(1e-3, 0.0, 0.0, np.deg2rad(2.0)), FOUND, 4)
    assert said is not None
    for part in ("1 mm", "2 degrees", "cell.camera", "cell.force_torque", "crosspih cell check"):
        assert part in said, said


def test_an_assembly_tells_when_vision_and_touch_contradict(tmp_path: Path) -> None:
    cell = CellInMemory(tmp_path)
    try:
        cell.reset(1)
        sound = cell.assemble()
        assert sound.inserted and sound.warnings == ()
        # the cameras were knocked: 1 mm, where they tell of 0.05
        cell.vision_lie = np.array([1e-3, 0.0, 0.0, 0.0, 0.0, 0.0])
        cell.vision_warnings = ("the left camera's lens is not as calibrated",)
        cell.reset(2)
        result = cell.assemble()
        assert result.inserted and len(result.warnings) == 2 and result.warnings[:1] == cell.vision_warnings
        figures = score(cell.cell.workcell, result, None, wall_s=1.0, recording=None)
        assert figures.warnings == result.warnings
        assert any("warning" in str(cell_) for cell_ in summary(figures).columns[0]._cells)
    finally:
        cell.close()


def test_an_inverted_sensor_is_refused_before_it_can_mislead(tmp_path: Path) -> None:
    """It was once called a success, T2 half a degree off: its weight points up, and the calibration sees that."""
    truth = TruthConfig(ft_factors=(-1.0,) * 6)
    cell = CellInMemory(tmp_path, simulated=SimulatedConfig(truth=truth), calibrated=False)
    try:
        cell.reset(1)
        result = cell.assemble()
        assert not result.inserted and result.failure is Failure.NOT_CALIBRATED
        assert "cell.force_torque.reports" in result.failure_detail
    finally:
        cell.close()
