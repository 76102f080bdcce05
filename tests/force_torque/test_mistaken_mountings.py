"""Calibrations of sensors that are mounted or read otherwise than the cell's file says: refused with the mend."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from crosspih_common.geometry.pose import Array
from crosspih_common.wrench import Payload
from services.force_torque.calibration import (
    CalibrationLimits,
    MountingTurned,
    NothingHangs,
    PosesDoNotSpan,
    ResidualsTooLarge,
    StaticReading,
    WeightDiffers,
    WeightPointsUp,
    calibrate,
)

WEIGHTS = st.floats(2.0, 40.0)
SEEDS = st.integers(0, 2**32 - 1)


def six_poses(rng: np.random.Generator) -> Array:
    """Each axis of the sensor up and down once, turned about the vertical as it happens."""
    axes: list[list[float]] = [
        [0, 0, 0],
        [np.pi, 0, 0],
        [np.pi / 2, 0, 0],
        [-np.pi / 2, 0, 0],
        [0, np.pi / 2, 0],
        [0, -np.pi / 2, 0],
    ]
    about = Rotation.from_rotvec(np.outer(rng.uniform(-np.pi, np.pi, 6), [0.0, 0.0, 1.0]))
    return np.asarray((about * Rotation.from_rotvec(axes)).as_matrix(), dtype=float)


def readings(
    seed: int,
    weight: float,
    turn_rad: Sequence[float] = (0.0, 0.0, 0.0),
    sign: float = 1.0,
    noise_n: float = 0.01,
    down: Sequence[float] = (0.0, 0.0, -1.0),
) -> list[StaticReading]:
    """What a sensor turned by a rotation vector of its own frame reports, taken for one that is not."""
    rng = np.random.default_rng(seed)
    payload = Payload(
        rng.normal(0.0, [4.0] * 3 + [0.1] * 3), weight * np.asarray(down, float), rng.uniform(-0.05, 0.05, 3)
    )
    turn = Rotation.from_rotvec(turn_rad).as_matrix()
    found = []
    for rotation in six_poses(rng):
        wrench = payload.free_air(rotation @ turn) - payload.bias
        noise = rng.normal(0.0, [noise_n] * 3 + [noise_n / 20.0] * 3)
        found.append(StaticReading(rotation, sign * wrench + payload.bias + noise))
    return found


@settings(max_examples=30, deadline=None, derandomize=True)
@given(SEEDS, WEIGHTS, st.booleans())
def test_a_reversed_sign_is_named(seed: int, weight: float, gravity_free: bool) -> None:
    with pytest.raises(WeightPointsUp, match=r"points up, 1\d\d degrees .*cell\.force_torque\.reports: reaction"):
        calibrate(readings(seed, weight, sign=-1.0), gravity_free=gravity_free)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    SEEDS, WEIGHTS, st.sampled_from([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, -2, 0.5)]), st.floats(15, 180), st.booleans()
)
def test_a_turned_sensor_is_named_with_its_turn(
    seed: int, weight: float, axis: tuple[float, ...], degrees: float, reversed_sign: bool
) -> None:
    turn = np.deg2rad(degrees) * np.array(axis) / np.linalg.norm(axis)
    with pytest.raises(MountingTurned, match=r"turned by .*cell\.force_torque\.pose_flange_sensor") as refusal:
        calibrate(readings(seed, weight, tuple(turn), -1.0 if reversed_sign else 1.0))
    found = refusal.value.fit
    away = Rotation.from_rotvec(turn).inv() * Rotation.from_rotvec(found.turn_rad)
    assert away.magnitude() < 0.02
    assert found.reversed_sign == reversed_sign
    assert ("reports: reaction" in str(refusal.value)) == reversed_sign
    assert np.linalg.norm(found.weight_base_n) == pytest.approx(weight, abs=0.05)


def test_the_turn_is_told_about_the_sensors_axis_and_the_right_way_round() -> None:
    for turn, words in (
        ((0.0, 0.0, np.pi / 6), r"turned by 30\.\d degrees about its z axis"),
        ((0.0, 0.0, -np.pi / 2), r"turned by -(90\.0|89\.9|90\.1) degrees about its z axis"),
        ((0.0, 0.7, 0.7), r"about the axis \(-?0\.00, 0\.71, 0\.7\d\) of its own frame"),
    ):
        with pytest.raises(MountingTurned, match=words):
            calibrate(readings(3, 9.5, turn, noise_n=0.002))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(SEEDS, st.floats(0.0, 0.1), st.floats(0.0, 0.05))
def test_a_sensor_with_nothing_on_it_is_named_so(seed: int, weight: float, noise_n: float) -> None:
    with pytest.raises(NothingHangs, match="no weight hangs on the sensor"):
        calibrate(readings(seed, weight, noise_n=noise_n))


def test_a_weight_lost_in_the_noise_is_no_weight() -> None:
    with pytest.raises(NothingHangs):
        calibrate(readings(1, 0.0, noise_n=0.3))


def test_poses_that_do_not_span_are_still_named_first() -> None:
    same = [StaticReading(np.eye(3), np.array([0.0, 0.0, -9.5, 0.0, 0.0, 0.0]))] * 6
    with pytest.raises(PosesDoNotSpan, match="add a pose"):
        calibrate(same)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(SEEDS, WEIGHTS, st.floats(0.0, 0.03), st.floats(0.0, 0.1))
def test_a_good_sensor_passes_with_a_little_turn_noise_or_tilt(
    seed: int, weight: float, turn: float, noise_n: float
) -> None:
    tilted = Rotation.from_rotvec([0.1, 0.05, 0.0]).apply([0.0, 0.0, -1.0])
    found = calibrate(readings(seed, weight, (turn / 2.0, 0.0, turn / 2.0), noise_n=noise_n, down=tuple(tilted)))
    assert found.payload.weight_n == pytest.approx(weight, rel=0.01, abs=0.3)


def test_one_touched_pose_is_not_taken_for_a_turn() -> None:
    for seed in range(20):
        touched = readings(seed, 9.5)
        away = np.random.default_rng(seed).normal(size=3)
        push = np.array([*(6.0 * away / np.linalg.norm(away)), 0.2, 0.0, 0.0])
        touched[2] = StaticReading(touched[2].rotation_base_sensor, touched[2].wrench + push)
        with pytest.raises(ResidualsTooLarge):
            calibrate(touched)


def test_the_base_may_hang_as_the_file_says_and_not_otherwise() -> None:
    wall = (-1.0, 0.0, 0.0)
    held = calibrate(readings(5, 9.5, down=wall), limits=CalibrationLimits(down_base=(-9.81, 0.0, 0.0)))
    assert held.payload.tilt_rad(wall) < 0.01
    assert calibrate(
        readings(5, 9.5, down=wall), gravity_free=False, limits=CalibrationLimits(down_base=wall)
    ).payload.weight_n == pytest.approx(9.5, abs=0.05)
    with pytest.raises(WeightPointsUp, match=r"points (90|89)\.\d degrees away .*gravity_base_m_s2: \[-9\.8"):
        calibrate(readings(5, 9.5, down=wall))


def test_the_weight_by_scales_tells_the_unit() -> None:
    with pytest.raises(WeightDiffers, match=r"reports lbf: set cell\.force_torque\.force_unit"):
        calibrate(readings(2, 9.5 / 4.448), limits=CalibrationLimits(weighed_n=9.5))
    assert calibrate(readings(2, 9.5), limits=CalibrationLimits(weighed_n=9.0)).payload.weight_n > 9.0
