"""Detects when the arm is at rest, and averages the sensor's readings then. Times are the cell's clock, at any rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import JointState, RawWrenchBatch
from crosspih_common.wrench import mean_and_sd

_STILL_RAD_S = 1e-3
_ACCELERATION_WINDOW_S = 0.03
_ACCELERATION_STEP_S = 0.0035  # closer in time, differences of encoder speeds are mostly noise


@dataclass(frozen=True, slots=True, eq=False)
class RestingReading:
    """The mean raw reading (6,) at rest and the standard deviation (6,) of that mean."""

    mean: Array
    sd: Array


class RestingWindow:
    """The last raw batches. The mean is over `window_s`; with less than `least_s` of rest there is no reading."""

    def __init__(self, window_s: float = 0.2, least_s: float = 0.05) -> None:
        self._window_ns, self._least_ns = int(window_s * 1e9), int(least_s * 1e9)
        self._batches: tuple[RawWrenchBatch, ...] = ()

    def add(self, batch: RawWrenchBatch) -> None:
        """Add the next batch; one older than the last restarts the window (the cell's clock was set back)."""
        kept = self._batches
        if kept and batch.stamp_ns < kept[-1].stamp_ns:
            kept = ()
        since = batch.stamp_ns - self._window_ns
        self._batches = (*(one for one in kept if one.stamp_ns >= since), batch)

    def reading(self, joints: Sequence[JointState], now_ns: int) -> RestingReading | None:
        """The mean reading at rest now; None while the arm moves or if the streams have stopped.

        joints: the last states, oldest first.
        """
        batches = self._batches
        if not batches or not joints or now_ns - batches[-1].stamp_ns > 2 * self._window_ns:
            return None
        moving = [state.stamp_ns for state in joints if np.max(np.abs(state.speeds_rad_s)) > _STILL_RAD_S]
        since = max([joints[0].stamp_ns, *moving])
        resting = [batch for batch in batches if batch.stamp_ns > since]
        if not resting or batches[-1].stamp_ns - since < self._least_ns:
            return None
        samples = np.concatenate([np.asarray(batch.samples, dtype=float) for batch in resting])
        if len(samples) < 2:
            return None
        return RestingReading(*mean_and_sd(samples))


def joint_acceleration_rad_s2(states: Sequence[JointState]) -> float:
    """The largest joint acceleration over the last 30 ms of joint states, by differences of their speeds, rad/s^2."""
    kept: list[JointState] = []
    for state in reversed(states):
        if states[-1].stamp_ns - state.stamp_ns > _ACCELERATION_WINDOW_S * 1e9 and len(kept) > 1:
            break
        if not kept or kept[-1].stamp_ns - state.stamp_ns >= _ACCELERATION_STEP_S * 1e9:
            kept.append(state)
    if len(kept) < 2:
        return 0.0
    speeds = np.array([state.speeds_rad_s for state in kept])
    steps = -np.diff(np.array([state.stamp_ns for state in kept]) * 1e-9)
    return float(np.max(np.abs(np.diff(speeds, axis=0)) / steps[:, None]))
