"""Contacts that begin and end, and drift in free air: the same however the samples are batched, and at any rate."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.geometry import wrench_of_force_at_point
from crosspih_common.geometry.pose import Array
from services.force_torque.compensation import (
    ContactChange,
    ContactEvent,
    FreeAirSettings,
    FreeAirState,
    OnsetSettings,
    OnsetState,
    watch_free_air,
    watch_onset,
)

PERIOD_S = 0.001


def push(forces: list[float]) -> Array:
    return wrench_of_force_at_point(np.array([[0.0, 0.0, -force] for force in forces]), np.array([0.0, 0.01, 0.07]))


def onset_events(wrenches: Array, batch: int) -> list[ContactEvent]:
    state, events = OnsetState(), []
    stamps = np.arange(len(wrenches)) * 1_000_000
    for at in range(0, len(wrenches), batch):
        state, new = watch_onset(state, OnsetSettings(), stamps[at : at + batch], wrenches[at : at + batch], PERIOD_S)
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
        state, report = watch_free_air(
            state, limits, rng.normal(0.0, [0.1] * 3 + [0.005] * 3, (10, 6)), False, PERIOD_S
        )
        assert not report.drifted
    assert report.settled
    assert report.force_n < 0.03
    first = None
    for step in range(200):
        batch = rng.normal([0.5, 0.0, 0.0, 0.0, 0.0, 0.0], [0.1] * 3 + [0.005] * 3, (10, 6))
        state, report = watch_free_air(state, limits, batch, False, PERIOD_S)
        first = step if report.drifted and first is None else first
    assert first is not None
    assert 20 < first < 100
    assert report.force_n == pytest.approx(0.5, abs=0.03)
    assert report.reason.startswith("mean force in free air 0.4")
    assert report.reason.endswith("calibrate the sensor again")


def test_contact_and_the_time_after_it_do_not_count_as_drift() -> None:
    state = FreeAirState(samples=500)
    state, _ = watch_free_air(state, FreeAirSettings(), push([20.0] * 100), True, PERIOD_S)
    state, report = watch_free_air(state, FreeAirSettings(), push([2.0] * 200), False, PERIOD_S)
    assert state.samples == 500
    assert not report.drifted
    state, report = watch_free_air(
        state, FreeAirSettings(), push([20.0] * 100), False, PERIOD_S
    )  # not noticed yet: gated
    assert state.samples == 500
    state, _ = watch_free_air(state, FreeAirSettings(), push([0.1] * 10), False, PERIOD_S)
    assert state.samples == 510


@pytest.mark.parametrize("rate_hz", [125, 500, 1000, 8000])
def test_times_hold_at_any_rate(rate_hz: int) -> None:
    period_s = 1.0 / rate_hz
    stamps = (np.arange(2 * rate_hz) * 1e9 / rate_hz).astype(np.int64)
    forces = np.where(stamps >= 1_000_000_000, 3.0, 0.0)
    spike = np.zeros(len(stamps))
    spike[rate_hz // 2] = 50.0
    _, events = watch_onset(OnsetState(), OnsetSettings(hold_s=0.02), stamps, push((forces + spike).tolist()), period_s)
    assert [(event.change, event.stamp_ns) for event in events] == [(ContactChange.BEGAN, 1_000_000_000)]

    limits = FreeAirSettings(mean_s=0.4, settle_s=0.1)
    state, report = watch_free_air(
        FreeAirState(), limits, push([0.5] * rate_hz)[: int(0.39 * rate_hz)], False, period_s
    )
    assert not report.settled
    state, report = watch_free_air(state, limits, push([0.5] * (rate_hz // 20)), False, period_s)
    assert report.settled and report.drifted
    state, _ = watch_free_air(state, limits, push([9.0]), True, period_s)
    before = state.samples
    state, _ = watch_free_air(state, limits, push([0.5] * rate_hz), False, period_s)
    assert (state.samples - before) * period_s == pytest.approx(0.9, abs=period_s)
