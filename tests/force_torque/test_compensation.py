"""Compensation at any orientation, filter, onset and drift: exact, and the same however the samples are batched."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose, transform_wrench, wrench_of_force_at_point
from crosspih_common.geometry.pose import Array
from services.force_torque.calibration import ToolParameters
from services.force_torque.compensation import (
    ContactChange,
    ContactEvent,
    FreeAirSettings,
    FreeAirState,
    LowPass,
    OnsetSettings,
    OnsetState,
    compensated,
    watch_free_air,
    watch_onset,
)

TOOL = ToolParameters(
    np.array([0.8, -0.5, 1.2, 0.03, -0.02, 0.01]), np.array([0.0, 0.0, -9.55]), np.array([0.001, 0.0, 0.033])
)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_only_the_contact_is_left_at_any_orientation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(rng=rng).as_matrix()
    contact = rng.normal(0.0, [10.0] * 3 + [1.0] * 3)
    pose_peg_sensor = Pose(Rotation.random(rng=rng).as_matrix(), rng.normal(0.0, 0.05, 3))
    raw = contact + TOOL.free_air_wrench(rotation)
    assert compensated(raw, rotation, TOOL) == pytest.approx(contact, abs=1e-12)
    moved = compensated(raw, rotation, TOOL, pose_peg_sensor)
    assert moved == pytest.approx(transform_wrench(pose_peg_sensor, contact), abs=1e-12)


def test_gravity_pulls_along_the_base_and_turns_about_the_centroid() -> None:
    tool = ToolParameters(np.zeros(6), np.array([0.0, 0.0, -10.0]), np.array([0.0, 0.0, 0.05]))
    level = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # sensor x up, z forward
    assert tool.free_air_wrench(level) == pytest.approx([-10.0, 0.0, 0.0, 0.0, -0.5, 0.0])


def test_batches_with_one_orientation_each() -> None:
    rotations = Rotation.random(5, rng=np.random.default_rng(2)).as_matrix()
    raw = np.array([TOOL.free_air_wrench(rotation) for rotation in rotations])
    assert compensated(raw, rotations, TOOL) == pytest.approx(np.zeros((5, 6)), abs=1e-12)
    with pytest.raises(ValueError, match="finite"):
        compensated(np.full(6, np.nan), np.eye(3), TOOL)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.lists(st.integers(1, 12), min_size=1, max_size=8), st.floats(1.0, 400.0))
def test_the_filter_does_not_feel_how_samples_are_batched(sizes: list[int], cutoff_hz: float) -> None:
    samples = np.random.default_rng(3).normal(size=(sum(sizes), 6))
    start = LowPass(cutoff_hz, 0.001)
    _, whole = start.filtered(samples)
    state, parts, at = start, [], 0
    for size in sizes:
        state, part = state.filtered(samples[at : at + size])
        parts.append(part)
        at += size
    assert np.concatenate(parts) == pytest.approx(whole, abs=1e-12)
    gain = 1.0 - np.exp(-2.0 * np.pi * cutoff_hz * 0.001)
    last = samples[0]
    for sample, filtered in zip(samples, whole, strict=True):
        last = last + gain * (sample - last)
        assert filtered == pytest.approx(last, abs=1e-12)


def test_a_step_reaches_63_percent_after_one_time_constant() -> None:
    state, _ = LowPass(10.0, 0.0001).filtered(np.zeros((1, 6)))
    count = round(1.0 / (2.0 * np.pi * 10.0) / 0.0001)
    _, output = state.filtered(np.ones((count, 6)))
    assert output[-1] == pytest.approx(np.full(6, 1.0 - np.exp(-1.0)), abs=1e-3)
    with pytest.raises(ValueError, match="cutoff_hz"):
        LowPass(0.0, 0.001)


def push(forces: list[float]) -> Array:
    return wrench_of_force_at_point(np.array([[0.0, 0.0, -force] for force in forces]), np.array([0.0, 0.01, 0.07]))


def onset_events(wrenches: Array, batch: int) -> list[ContactEvent]:
    state, events = OnsetState(), []
    stamps = np.arange(len(wrenches)) * 1_000_000
    for at in range(0, len(wrenches), batch):
        state, new = watch_onset(state, OnsetSettings(), stamps[at : at + batch], wrenches[at : at + batch])
        events += new
    return events


@pytest.mark.parametrize("batch", [1, 3, 10, 1000])
def test_onset_is_stamped_at_its_first_sample_and_a_spike_is_not_one(batch: int) -> None:
    forces = [0.0] * 20 + [5.0] * 3 + [0.0] * 10 + [2.0] * 30 + [0.8] * 20 + [0.1] * 20
    events = onset_events(push(forces), batch)
    assert [(event.change, event.stamp_ns) for event in events] == [
        (ContactChange.BEGAN, 33_000_000),
        (ContactChange.ENDED, 83_000_000),  # 0.8 N is between release and threshold: still in contact
    ]
    assert events[0].wrench[2] == -2.0


def test_a_moment_alone_is_a_contact_too() -> None:
    wrenches = np.zeros((10, 6))
    wrenches[4:, 5] = 0.1
    assert [event.stamp_ns for event in onset_events(wrenches, 10)] == [4_000_000]


def test_noise_does_not_start_a_contact() -> None:
    noise = np.random.default_rng(4).normal(0.0, [0.1] * 3 + [0.005] * 3, (20_000, 6))
    assert onset_events(noise, 10) == []


def test_drift_is_reported_only_once_it_is_known() -> None:
    rng = np.random.default_rng(6)
    limits = FreeAirSettings()
    state = FreeAirState()
    for _ in range(100):
        state, report = watch_free_air(state, limits, rng.normal(0.0, [0.1] * 3 + [0.005] * 3, (10, 6)), False)
        assert not report.drifted
    assert report.settled
    assert report.force_n < 0.03
    first = None
    for step in range(200):
        batch = rng.normal([0.5, 0.0, 0.0, 0.0, 0.0, 0.0], [0.1] * 3 + [0.005] * 3, (10, 6))
        state, report = watch_free_air(state, limits, batch, False)
        first = step if report.drifted and first is None else first
    assert first is not None
    assert 20 < first < 100
    assert report.force_n == pytest.approx(0.5, abs=0.03)
    assert report.reason.startswith("mean force in free air 0.4")
    assert report.reason.endswith("calibrate the sensor again")


def test_contact_and_the_time_after_it_do_not_count_as_drift() -> None:
    state = FreeAirState(samples=500)
    state, _ = watch_free_air(state, FreeAirSettings(), push([20.0] * 100), True)
    state, report = watch_free_air(state, FreeAirSettings(), push([2.0] * 200), False)
    assert state.samples == 500
    assert not report.drifted
    state, report = watch_free_air(state, FreeAirSettings(), push([20.0] * 100), False)  # not noticed yet: gated
    assert state.samples == 500
    state, _ = watch_free_air(state, FreeAirSettings(), push([0.1] * 10), False)
    assert state.samples == 510
