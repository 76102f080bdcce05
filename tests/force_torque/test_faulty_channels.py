"""Readings of a sensor with a fault in a channel, or noisier than its residuals allow: the cause is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.geometry.pose import Array
from crosspih_common.wrench import mean_and_sd
from services.force_torque.calibration import ChannelAtFault, StaticReading, calibrate
from tests.force_torque.test_mistaken_mountings import readings

NAMES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
SEEDS = st.integers(0, 10_000)


def changed(given: list[StaticReading], by: Array) -> list[StaticReading]:
    """(n, 6) added."""
    return [replace(one, wrench=one.wrench + more) for one, more in zip(given, by, strict=True)]


@settings(max_examples=25, deadline=None, derandomize=True)
@given(SEEDS, st.integers(0, 2), st.booleans(), st.floats(0.3, 0.8))
def test_a_clipped_force_is_named(seed: int, axis: int, upper: bool, share: float) -> None:
    """In twelve poses two lie beyond the stop, turned about the vertical against each other."""
    whole = readings(seed, 12.0) + readings(seed + 1, 12.0)
    first, second = whole[:6], whole[6:]
    # one bias for both
    bias = [np.mean([one.wrench for one in part], axis=0) for part in (first, second)]
    second = changed(second, np.tile(bias[0] - bias[1], (6, 1)))
    side = 1.0 if upper else -1.0
    values = np.array([side * one.wrench[axis] for one in (*first, *second)])
    stop = np.median(values) + share * 12.0
    clipped = []
    for one in (*first, *second):
        wrench = one.wrench.copy()
        wrench[axis] = side * min(side * wrench[axis], stop)
        clipped.append(replace(one, wrench=wrench))
    with pytest.raises(ChannelAtFault, match=rf"{NAMES[axis]} stops at .*the channel is clipped"):
        calibrate(clipped)


def test_a_force_that_is_stuck_is_named() -> None:
    for axis in range(3):
        held = [replace(one, wrench=np.where(np.arange(6) == axis, 1.25, one.wrench)) for one in readings(4, 9.5)]
        with pytest.raises(ChannelAtFault, match=rf"{NAMES[axis]} is 1\.25 N in all poses .*stuck"):
            calibrate(held)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(SEEDS, st.integers(0, 5), st.booleans())
def test_a_channel_that_drifts_is_named(seed: int, axis: int, upper: bool) -> None:
    much = (4.0 if axis < 3 else 0.4) * (1.0 if upper else -1.0)
    ramp = np.outer(np.linspace(-0.5, 0.5, 6), np.eye(6)[axis]) * much
    with pytest.raises(ChannelAtFault, match=rf"{NAMES[axis]} drifts by {'.' if upper else '-'}"):
        calibrate(changed(readings(seed, 20.0), ramp))
    # too little to refuse, and told
    told = calibrate(changed(readings(seed, 20.0, noise_n=0.002), ramp * 0.08)).warnings
    assert any(NAMES[axis] in one and "drifts by" in one for one in told)


def test_residuals_far_above_the_noise_are_told() -> None:
    rng = np.random.default_rng(1)
    quiet = [replace(one, sd=np.full(6, 0.005)) for one in readings(2, 9.5, noise_n=0.005)]
    assert calibrate(quiet).warnings == ()
    loose = changed(quiet, rng.normal(0.0, [0.35] * 3 + [0.0] * 3, (6, 6)))
    (warning,) = calibrate(loose).warnings
    assert "times what the readings' noise explains" in warning and int(warning.split(" are ")[1].split()[0]) > 20


def test_copies_make_a_calibration_no_surer() -> None:
    once = readings(3, 9.5)
    assert calibrate(once * 4).bias_sd == pytest.approx(calibrate(once).bias_sd)
    assert calibrate(once * 4).poses == (0, 1, 2, 3, 4, 5)


def test_a_sample_told_again_counts_once() -> None:
    samples = np.random.default_rng(0).normal(size=(50, 6))
    for times in (1, 4):
        mean, sd = mean_and_sd(np.repeat(samples, times, axis=0))
        assert mean == pytest.approx(samples.mean(axis=0))
        assert sd == pytest.approx(samples.std(axis=0, ddof=1) / np.sqrt(50))
    assert mean_and_sd(np.ones((9, 6)))[1].tolist() == [0.0] * 6
