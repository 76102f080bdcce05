"""A device's time on this machine's clock: whatever the delays, the truth lies within the uncertainty that is told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.hardware.device_clock import DeviceClock

BEST_S = 5e-4
HOST0_NS = 123_456_789_000_000
SLACK_S = 2e-8  # of rounding: stamps are whole nanoseconds, device times are floats


@dataclass(frozen=True)
class Transport:
    """What is drawn of a device and of the way from it to here."""

    seed: int
    rate_hz: float
    drift_ppm: float
    wander_ppm_s: float
    least_s: float
    jitter_s: float
    burst_s: float
    bursts: int

    def arrivals(self, seconds: float, began_s: float = 0.0) -> tuple[Array, Array, NDArray[np.int64]]:
        """Device times (n,), when they really were here, s, and when they arrived, ns."""
        rng = np.random.default_rng(self.seed)
        device_s = began_s + np.arange(round(seconds * self.rate_hz)) / self.rate_hz
        passed_s = device_s - began_s
        # the rate wanders to and fro, by no more than was said
        turn_s = 7.0
        wandered = self.wander_ppm_s * 1e-6 * turn_s**2 * (1.0 - np.cos(passed_s / turn_s))
        true_s = passed_s * (1.0 + self.drift_ppm * 1e-6) + wandered
        delays = self.least_s + rng.exponential(self.jitter_s, len(true_s))
        second, within_s = np.divmod(passed_s, 1.0)
        for slot in rng.permutation(int(np.ceil(seconds)))[: self.bursts]:
            # everything is held up for a while, and comes at its end
            end_s = rng.uniform(self.burst_s, 0.88)
            held = (second == slot) & (within_s >= end_s - self.burst_s) & (within_s < end_s)
            delays[held] += end_s - within_s[held]
        # what is promised of the transport: whichever span one looks at, something comes in it at once
        delays[within_s >= 0.93] = self.least_s
        arrived_s = np.maximum.accumulate(true_s + delays)  # nothing overtakes
        return device_s, true_s, HOST0_NS + np.rint(arrived_s * 1e9).astype(np.int64)


transports = st.builds(
    Transport,
    seed=st.integers(0, 2**32 - 1),
    rate_hz=st.sampled_from([97.0, 250.0, 700.0]),
    drift_ppm=st.floats(-250.0, 250.0),
    wander_ppm_s=st.floats(-0.4, 0.4),
    least_s=st.floats(0.0, BEST_S),
    jitter_s=st.sampled_from([1e-5, 2e-4, 3e-3]),
    burst_s=st.floats(0.0, 0.4),
    bursts=st.integers(0, 6),
)


def follow(clock: DeviceClock, device_s: Array, true_s: Array, arrived_ns: NDArray[np.int64]) -> Array:
    """Observes all; asserts that each is where it is said to be; the uncertainties."""
    told = np.empty(len(device_s))
    for k, (device, arrived) in enumerate(zip(device_s.tolist(), arrived_ns.tolist(), strict=True)):
        clock.observe(device, arrived)
        off_s = (clock.to_host_ns(device) - HOST0_NS) * 1e-9 - true_s[k]
        told[k] = clock.uncertainty_s
        assert abs(off_s) <= told[k] + SLACK_S, (k, off_s, told[k])
    return told


@settings(max_examples=40)
@given(transports)
def test_the_truth_lies_within_the_uncertainty(transport: Transport) -> None:
    clock = DeviceClock()
    told = follow(clock, *transport.arrivals(9.0))
    assert clock.restarts == 0
    assert abs(clock.drift_ppm - transport.drift_ppm) <= clock.drift_uncertainty_ppm + 6.0  # and what it wandered
    # the bound is of the best delay, not of the usual one; wider where the way is bad for a while
    if transport.jitter_s < 1e-3 and not transport.bursts:
        assert told[-1] < 0.8 * BEST_S


@settings(max_examples=30)
@given(transports, st.floats(3.0, 9.0), st.floats(0.0, 3.0))
def test_a_device_that_was_restarted_is_noticed_at_once(transport: Transport, ran_s: float, off_s: float) -> None:
    clock = DeviceClock()
    follow(clock, *transport.arrivals(ran_s, began_s=5.0))
    # it counts from nought again, a while later
    device_s, true_s, arrived_ns = transport.arrivals(6.0)
    gone_s = ran_s + 1.0 + off_s
    follow(clock, device_s, true_s + gone_s, arrived_ns + round(gone_s * 1e9))
    assert clock.restarts == 1 and clock.settled


@settings(max_examples=30)
@given(transports, st.floats(0.5, 5.5))
def test_a_counter_that_wraps_goes_on(transport: Transport, wraps_at_s: float) -> None:
    wrap_s = 2**32 / 7000.0
    clock = DeviceClock(wrap_s=wrap_s)
    device_s, true_s, arrived_ns = transport.arrivals(8.0, began_s=wrap_s - wraps_at_s)
    follow(clock, device_s % wrap_s, true_s, arrived_ns)
    assert clock.restarts == 0


def test_spans_in_which_nothing_came_in_time_are_struck_out() -> None:
    """Two seconds in which all is 30 ms late: more than was promised, and told by what comes before and after."""
    device_s, true_s, arrived_ns = Transport(1, 1000.0, 40.0, 0.0, 1e-4, 1e-4, 0.0, 0).arrivals(20.0)
    late = (device_s > 9.5) & (device_s < 11.6)
    clock = DeviceClock()
    follow(clock, device_s, true_s, arrived_ns + np.where(late, 30_000_000, 0))
    assert clock.struck >= 1 and clock.restarts == 0 and clock.uncertainty_s < 4e-4


def test_a_clock_that_was_put_back_is_noticed_after_some_spans() -> None:
    device_s, true_s, arrived_ns = Transport(2, 500.0, -30.0, 0.0, 1e-4, 1e-4, 0.0, 0).arrivals(20.0)
    clock = DeviceClock()
    for d, h in zip(device_s, arrived_ns + np.where(device_s > 8.0, 200_000_000, 0), strict=True):
        clock.observe(float(d), int(h))
    assert clock.restarts == 1
    off_s = (clock.to_host_ns(float(device_s[-1])) - HOST0_NS) * 1e-9 - (true_s[-1] + 0.2)
    assert abs(off_s) <= clock.uncertainty_s < 4e-4


def test_there_and_back_again() -> None:
    wrap_s = 2**32 / 7000.0
    clock = DeviceClock(wrap_s=wrap_s)
    device_s, true_s, arrived_ns = Transport(3, 1000.0, 120.0, 0.0, 0.0, 1e-4, 0.0, 0).arrivals(5.0, wrap_s - 2.0)
    follow(clock, device_s % wrap_s, true_s, arrived_ns)
    asked = device_s[-500:] % wrap_s
    back = clock.many_to_device_s(clock.many_to_host_ns(asked))
    assert back == pytest.approx(asked, abs=1e-8)


def test_nothing_is_told_before_anything_came() -> None:
    clock = DeviceClock()
    assert clock.uncertainty_s == float("inf") and not clock.settled
    with pytest.raises(ValueError, match="observe an arrival"):
        clock.to_host_ns(0.0)
