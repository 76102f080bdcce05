"""Quintic motion: Eqs. 10-11 as known answers, limits never exceeded, boundary values met."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.arm import xb4
from crosspih_common.arm.quintic import JointSample, JointTrajectory, Quintic
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.planning.trajectory import (
    TrajectoryError,
    connect,
    joined,
    move_joints,
    move_line,
    move_through,
    rest_duration_s,
    scaled_limits,
    straight_poses,
)

ARM = xb4()
LIMITS = ARM.limits
HERE = np.array([-0.9419, 1.0352, 0.3222, -0.9528, -1.4459, 0.1735])
TOOL = Pose.from_translation([0.0, 0.0, 0.146])


def vectors(low: Array, high: Array) -> st.SearchStrategy[Array]:
    pairs = zip(low.tolist(), high.tolist(), strict=True)
    return st.tuples(*(st.floats(a, b, allow_nan=False) for a, b in pairs)).map(np.array)


joint_vectors = vectors(LIMITS.lower_rad, LIMITS.upper_rad)
speeds = vectors(-LIMITS.speed_rad_s, LIMITS.speed_rad_s)
accelerations = vectors(-LIMITS.acceleration_rad_s2, LIMITS.acceleration_rad_s2)
samples = st.builds(JointSample, joint_vectors, speeds, accelerations)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(samples, samples, st.floats(0.1, 5.0))
def test_the_six_boundary_values_are_met(start: JointSample, goal: JointSample, duration: float) -> None:
    quintic = Quintic.between(start, goal, duration)
    for wanted, time in ((start, 0.0), (goal, duration)):
        got = quintic.sample(time)
        assert got.position_rad == pytest.approx(wanted.position_rad, abs=1e-8)
        assert got.velocity_rad_s == pytest.approx(wanted.velocity_rad_s, abs=1e-7)
        assert got.acceleration_rad_s2 == pytest.approx(wanted.acceleration_rad_s2, abs=1e-6)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(samples, samples, st.floats(0.1, 3.0))
def test_exact_peaks_bound_dense_samples_and_are_attained(
    start: JointSample, goal: JointSample, duration: float
) -> None:
    quintic = Quintic.between(start, goal, duration)
    times = np.linspace(0.0, duration, 2001)
    for order in (0, 1, 2):
        coefficients = quintic.derivative(order)
        dense = times[:, None] ** np.arange(len(coefficients)) @ coefficients
        low, high = quintic.extremes(order)
        size = np.abs(dense).max() + 1e-9
        assert np.all(dense.max(axis=0) <= high + 1e-9 * size)
        assert np.all(dense.min(axis=0) >= low - 1e-9 * size)
        assert np.all(high - dense.max(axis=0) <= 1e-3 * size)
        assert np.all(dense.min(axis=0) - low <= 1e-3 * size)


def test_coefficients_of_eq_11_from_rest_to_rest() -> None:
    goal = np.array([1.0, 2.0, -1.0, 0.5, 0.0, 3.0])
    quintic = Quintic.between(JointSample.at_rest(np.zeros(6)), JointSample.at_rest(goal), 2.0)
    assert quintic.coefficients[3] == pytest.approx(10.0 * goal / 2.0**3)
    assert quintic.coefficients[4] == pytest.approx(-15.0 * goal / 2.0**4)
    assert quintic.coefficients[5] == pytest.approx(6.0 * goal / 2.0**5)
    # Eq. 10, mended: the end acceleration is 2 a2 + 6 a3 T + 12 a4 T^2 + 20 a5 T^3.
    a = quintic.coefficients
    assert 2 * a[2] + 6 * a[3] * 2.0 + 12 * a[4] * 4.0 + 20 * a[5] * 8.0 == pytest.approx(np.zeros(6), abs=1e-12)
    assert quintic.peak(1) == pytest.approx(1.875 * np.abs(goal) / 2.0)
    assert quintic.peak(2) == pytest.approx(10.0 / np.sqrt(3.0) * np.abs(goal) / 4.0)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(joint_vectors, joint_vectors)
def test_rest_to_rest_never_exceeds_a_limit_and_is_the_fastest(start: Array, goal: Array) -> None:
    trajectory = move_joints(start, goal, LIMITS)
    assert trajectory.violations(LIMITS) == []
    if trajectory.duration_s > 0.0201:
        assert trajectory.stretched(0.999).violations(LIMITS) != []
    assert trajectory.sample(trajectory.duration_s).position_rad == pytest.approx(goal, abs=1e-9)


def test_durations_in_closed_form() -> None:
    slow = scaled_limits(LIMITS, 0.1, 1.0)
    distance = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert rest_duration_s(distance, slow) == pytest.approx(1.875 / (0.1 * np.deg2rad(310.0)))
    assert rest_duration_s(0.01 * distance, LIMITS) == pytest.approx(np.sqrt(0.057735027 / np.deg2rad(1500.0)))
    with pytest.raises(ValueError, match="speed_scale"):
        scaled_limits(LIMITS, 0.0)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    vectors(HERE - 0.4, HERE + 0.4),
    vectors(-0.3 * LIMITS.speed_rad_s, 0.3 * LIMITS.speed_rad_s),
    vectors(-0.2 * LIMITS.acceleration_rad_s2, 0.2 * LIMITS.acceleration_rad_s2),
)
def test_connecting_moving_states_stays_inside_or_says_what_forbids_it(
    position: Array, velocity: Array, acceleration: Array
) -> None:
    start, goal = JointSample(position, velocity, acceleration), JointSample.at_rest(HERE + 0.2)
    try:
        trajectory = connect(start, goal, LIMITS)
    except TrajectoryError as error:
        assert "joint" in str(error)
        return
    assert trajectory.violations(LIMITS) == []
    assert trajectory.sample(0.0).velocity_rad_s == pytest.approx(velocity, abs=1e-9)
    assert trajectory.sample(trajectory.duration_s).position_rad == pytest.approx(goal.position_rad, abs=1e-9)


def test_connecting_states_at_rest_finds_the_closed_form() -> None:
    start, goal = JointSample.at_rest(HERE), JointSample.at_rest(HERE + 0.3)
    closed = rest_duration_s(np.full(6, 0.3), LIMITS)
    assert connect(start, goal, LIMITS).duration_s == pytest.approx(closed, rel=1e-5)


def test_refusals_name_the_joint() -> None:
    with pytest.raises(TrajectoryError, match=r"goal_rad: joint 2 at 3\.0000 rad is outside"):
        move_joints(HERE, [0.0, 3.0, 0.0, 0.0, 0.0, 0.0], LIMITS)
    too_fast = JointSample(HERE, np.array([0.0, 0.0, 9.0, 0.0, 0.0, 0.0]), np.zeros(6))
    with pytest.raises(TrajectoryError, match="start: joint 3 is asked for too much speed"):
        connect(too_fast, JointSample.at_rest(HERE), LIMITS)
    with pytest.raises(ValueError, match="one finite number a joint"):
        JointSample.at_rest([0.0, 0.0, np.nan, 0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="each later"):
        JointTrajectory(np.array([0.0, 0.0]), np.zeros((2, 6)), np.zeros((2, 6)), np.zeros((2, 6)))


def test_a_line_next_to_a_singularity_is_refused_not_crawled() -> None:
    straight = np.array([0.0, 0.3, 0.1, 0.0, 1e-7, 0.0])
    goal = ARM.pose_base_flange(straight) @ Pose.from_rotvec([0.1, 0.0, 0.0], [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="singular"):
        move_line(ARM, straight, goal, LIMITS)


def test_waypoints_are_passed_in_order_and_rests_are_not_doubled() -> None:
    points = np.array([HERE, HERE + 0.1, HERE + 0.1, HERE - 0.2])
    trajectory = move_through(points, LIMITS)
    assert len(trajectory.times_s) == 3
    assert trajectory.violations(LIMITS) == []
    assert trajectory.positions_rad[1] == pytest.approx(HERE + 0.1)
    assert move_through(np.array([HERE, HERE]), LIMITS).positions_rad[-1] == pytest.approx(HERE)
    with pytest.raises(TrajectoryError, match="part 1 starts"):
        joined([move_joints(HERE, HERE + 0.1, LIMITS), move_joints(HERE, HERE + 0.1, LIMITS)])


def test_sampling_keeps_the_motion() -> None:
    trajectory = move_joints(HERE, HERE + 0.5, LIMITS)
    fine = trajectory.sampled(0.004)
    assert fine.duration_s == trajectory.duration_s
    assert np.diff(fine.times_s).max() <= 0.004 + 1e-12
    for time in np.linspace(0.0, trajectory.duration_s, 97):
        assert fine.sample(time).position_rad == pytest.approx(trajectory.sample(time).position_rad, abs=1e-9)


@pytest.mark.parametrize(
    ("turn", "travel"),
    [((0.1, 0.05, 0.2), (-0.03, 0.02, -0.08)), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.05)), ((0.0, 0.1, 0.0), (0.0, 0.0, 0.0))],
)
def test_a_line_is_straight_between_its_knots_and_inside_all_limits(
    turn: tuple[float, ...], travel: tuple[float, ...]
) -> None:
    start = ARM.pose_base_flange(HERE) @ TOOL
    goal = start @ Pose.from_rotvec(turn, travel)
    trajectory = move_line(ARM, HERE, goal, LIMITS, pose_flange_point=TOOL, speed_m_s=0.1, acceleration_m_s2=1.0)
    assert trajectory.violations(LIMITS) == []
    length = start.distance_to_m(goal)
    before = start
    times = np.linspace(0.0, trajectory.duration_s, 401)
    for time in times[1:]:
        point = ARM.pose_base_flange(trajectory.sample(time).position_rad) @ TOOL
        fraction = point.distance_to_m(start) / length if length > 0.0 else point.angle_to_rad(start) / 0.1
        ideal = straight_poses(start, goal, [fraction])[0]
        assert point.distance_to_m(ideal) < 1e-7
        assert point.angle_to_rad(ideal) < 1e-6
        assert point.distance_to_m(before) / times[1] < 0.1 * 1.001
        before = point
    assert before.distance_to_m(goal) < 1e-9
