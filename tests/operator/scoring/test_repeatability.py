"""The spread of found poses: known answers, and what must not count."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from crosspih_common.geometry import Pose
from services.operator.scoring.repeatability import repeatability

HOLE = Pose.from_rotvec([0.1, -2.0, 0.3], [0.4, -0.3, 0.2])


def off(x_mm: float = 0.0, depth_mm: float = 0.0, turn_deg: float = 0.0, tilt_deg: float = 0.0) -> Pose:
    rotvec = np.deg2rad([tilt_deg, 0.0, turn_deg])
    return HOLE @ Pose.from_rotvec(rotvec, np.array([x_mm, 0.0, depth_mm]) * 1e-3)


def test_known_spreads() -> None:
    found = repeatability([off(0.01), off(-0.01)])
    assert found is not None and found.count == 2
    assert found.sd_lateral_mm == pytest.approx(0.01 * np.sqrt(2.0))
    assert found.largest_lateral_mm == pytest.approx(0.01)
    assert found.sd_depth_mm == pytest.approx(0.0, abs=1e-9) and found.largest_rotation_deg < 1e-5
    found = repeatability([off(depth_mm=0.1, turn_deg=0.2), off(depth_mm=-0.1, turn_deg=-0.2)])
    assert found is not None
    assert found.sd_depth_mm == pytest.approx(0.1 * np.sqrt(2.0))
    assert found.sd_turn_deg == pytest.approx(0.2 * np.sqrt(2.0), rel=1e-4) and found.sd_tilt_deg < 1e-5


def test_one_pose_tells_no_spread() -> None:
    assert repeatability([HOLE]) is None and repeatability([]) is None


@given(some.lists(some.integers(0, 3), min_size=2, max_size=6))
def test_quarter_turns_of_the_cross_do_not_count(quarters: list[int]) -> None:
    found = repeatability([off(turn_deg=90.0 * quarter) for quarter in quarters], 4)
    assert found is not None and found.largest_rotation_deg < 1e-4


@given(some.lists(some.floats(-180.0, 180.0), min_size=2, max_size=6))
def test_no_turn_of_a_round_peg_counts(turns_deg: list[float]) -> None:
    found = repeatability([off(turn_deg=turn) for turn in turns_deg], 0)
    assert found is not None and found.sd_turn_deg is None and found.largest_rotation_deg < 1e-4
