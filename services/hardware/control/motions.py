"""Motions as generators: each yields where the joints are to be next and is sent what was felt there.

A motion ends by returning why. It does not know of caps and stops: whoever runs it cuts it short (execution.py).
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rows import rows_of
from crosspih_common.messages import StopReason
from services.hardware.control.cycle import CycleReading, Reference
from services.hardware.control.pace import Pace
from services.hardware.control.paths import TimedPath
from services.hardware.control.runner import Runner

SETTLE_S = 0.03
POSE_S = 0.005  # gravity on the sensor turns slowly enough to look at the orientation this often


@dataclass(frozen=True, slots=True)
class MotionEnding:
    """Why a motion ended."""

    reason: StopReason
    detail: str = ""


Steps = Generator[Reference, CycleReading, MotionEnding]


class Motion(Protocol):
    """One commanded motion."""

    def steps(self, runner: Runner) -> Steps:
        """Run it, a cycle at a time."""


class Along:
    """Along a timed path, at its own pace or slower where the pace says so, then still for 30 ms."""

    def __init__(self, path: TimedPath, pace: Pace) -> None:
        self._path, self._pace = path, pace

    def steps(self, runner: Runner) -> Steps:
        """From rest to rest."""
        period_s = runner.period_s
        at_s, *at_each = self._pace.samples(self._path.duration_s, period_s)
        rates, touching = (values.tolist() for values in at_each)
        pose_every = max(1, round(POSE_S / period_s))
        last = len(at_s) - 1
        for index, (joints, speeds) in enumerate(self._path.samples(at_s)):
            turned = index % pose_every == 0 or index == last
            rate = rates[index]
            yield Reference(
                joints,
                speeds if rate == 1.0 else speeds * rate,
                rows_of(runner.forward(joints).rotation) if turned else None,
                tip_speed_m_s=touching[index],
            )
        for _ in range(cycles(SETTLE_S, period_s)):
            yield runner.still()
        return MotionEnding(StopReason.COMPLETED)


class Hold:
    """Still, averaging the sensor over all but the first settling time."""

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s
        self.samples: list[Array] = []

    def steps(self, runner: Runner) -> Steps:
        """For the duration."""
        count = cycles(self._duration_s, runner.period_s)
        skip = min(cycles(SETTLE_S, runner.period_s), count // 2)
        for index in range(count):
            reading = yield runner.still()
            if index >= skip:
                self.samples.extend(reading.samples)
        return MotionEnding(StopReason.COMPLETED)


def cycles(duration_s: float, period_s: float) -> int:
    """How many cycles a time takes, at least one."""
    return max(1, round(duration_s / period_s))


def brake(runner: Runner, limits_rad_s2: Array) -> Generator[Reference, CycleReading, None]:
    """To rest as fast as the joints' limits allow, all joints together, from whatever the last cycle's speed was."""
    speeds, period_s = runner.speeds_rad_s, runner.period_s
    count = int(np.ceil(float(np.max(np.abs(speeds) / limits_rad_s2)) / period_s - 1e-9))
    for index in range(1, count + 1):
        slower = speeds * (1.0 - index / count)
        joints = runner.joints_rad + slower * period_s
        yield Reference(joints, slower, rows_of(runner.forward(joints).rotation))
