"""The guarded move: straight on until something is felt, then observed while still creeping.

Friction keeps the direction of sliding only while the peg slides, so wrench and pose are averaged over the last samples
of the creep, not after it. The onset is looked for backwards from the threshold: where the force left the noise of free
air.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from math import sqrt

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rows import Rows, rows_of
from crosspih_common.messages import GuardedMove, StopReason
from services.hardware.control.cycle import CycleReading, Reference
from services.hardware.control.motions import MotionEnding, Steps, cycles
from services.hardware.control.paths import StraightPath
from services.hardware.control.runner import Runner

FREE_SKIP_S = 0.01
FREE_S = 0.03
OVERSHOOT_M = 0.002
ONSET_S = 0.025
_RETREAT_M_S = 0.05
_RETREAT_M_S2 = 0.5


def ramp_m_s2(speed_m_s: float) -> float:
    """How fast to gather speed: gently, for the payload's inertia is felt as force."""
    return min(1.0, max(0.1, speed_m_s / 0.05))


class Guarded:
    """One guarded move; what it found stands in its attributes afterwards."""

    def __init__(self, path: StraightPath, command: GuardedMove, period_s: float, braking_m_s2: float) -> None:
        self._path = path
        self._command = command
        self._period_s, self._braking_m_s2 = period_s, braking_m_s2
        self.travel_m = 0.0
        self.free_raw: Array | None = None
        self.onset_m: float | None = None
        self.observed_raw: Array | None = None  # (n, 6)
        self.observed_joints_rad: Array | None = None
        self.observed_travel_m: float | None = None
        self._speed = 0.0
        # kept all along: the first reference says it, the others keep it
        self._orientation: Rows | None = rows_of(path.pose_at(0.0).rotation)

    def steps(self, runner: Runner) -> Steps:
        """Free air, approach, creep, retreat."""
        free: list[Array] = []
        felt: list[Sequence[float]] = []
        skip, count = cycles(FREE_SKIP_S, self._period_s), cycles(FREE_S, self._period_s)
        for index in range(skip + count):
            reading = yield runner.still()
            if index >= skip:
                free.append(reading.raw)
                felt.append(reading.contact)
        self.free_raw = np.mean(free, axis=0)
        offset: list[float] = np.mean(felt, axis=0).tolist()
        if runner.payload is not None and self._over(offset):
            # It touches already: the tare would hide that.
            offset = [0.0] * 6
        touched = yield from self._approach(runner, offset)
        if not touched:
            return MotionEnding(
                StopReason.TRAVEL_LIMIT, f"nothing felt within {self._command.travel_limit_m * 1e3:.1f} mm"
            )
        yield from self._creep(runner)
        yield from self._retreat(runner)
        return MotionEnding(StopReason.CONTACT)

    def _over(self, contact: Sequence[float]) -> bool:
        fx, fy, fz, mx, my, mz = contact
        return (
            fx * fx + fy * fy + fz * fz >= self._command.force_threshold_n**2
            or mx * mx + my * my + mz * mz >= self._command.moment_threshold_nm**2
        )

    def _go(self, speed: float) -> Reference:
        self._speed = speed
        self.travel_m += speed * self._period_s
        joints, slope = self._path.at(self.travel_m)
        orientation, self._orientation = self._orientation, None
        return Reference(joints, slope * speed, orientation, tip_speed_m_s=speed)

    def _approach(self, runner: Runner, offset: list[float]) -> Generator[Reference, CycleReading, bool]:
        command = self._command
        ramp = ramp_m_s2(command.speed_m_s)
        travels, contacts = [], []
        while True:
            left = command.travel_limit_m - self.travel_m
            if left < 1e-6:
                return False
            speed = min(command.speed_m_s, self._speed + ramp * self._period_s, max(2e-4, sqrt(2.0 * ramp * left)))
            reading: CycleReading = yield self._go(min(speed, left / self._period_s))
            contact = [felt - free for felt, free in zip(reading.contact, offset, strict=True)]
            travels.append(self.travel_m)
            contacts.append(contact)
            if self._over(contact):
                self.onset_m = onset(np.array(travels), np.array(contacts), self._period_s)
                return True

    def _creep(self, runner: Runner) -> Generator[Reference, CycleReading, None]:
        command = self._command
        observed = cycles(command.average_s, self._period_s)
        count = max(observed, cycles(command.observe_s, self._period_s))
        samples, joints, travels = [], [], []
        for _ in range(count):
            speed = max(command.creep_speed_m_s, self._speed - self._braking_m_s2 * self._period_s)
            reference = self._go(speed)
            reading = yield reference
            samples.append(reading.samples)
            joints.append(reading.joints_rad)
            travels.append(self.travel_m)
        last = slice(count - observed, count)
        self.observed_raw = np.concatenate(samples[last])
        self.observed_joints_rad = np.mean(joints[last], axis=0)
        self.observed_travel_m = float(np.mean(travels[last]))

    def _retreat(self, runner: Runner) -> Generator[Reference, CycleReading, None]:
        there = self.travel_m
        left = min(self._command.retreat_m, there)
        speed = 0.0
        while left > 1e-9:
            speed = min(
                _RETREAT_M_S, speed + _RETREAT_M_S2 * self._period_s, max(2e-4, sqrt(2.0 * _RETREAT_M_S2 * left))
            )
            speed = min(speed, left / self._period_s)
            left -= speed * self._period_s
            s = there - min(self._command.retreat_m, there) + left
            joints, slope = self._path.at(s)
            yield Reference(joints, -slope * speed)


def onset(travels_m: Array, contacts: Array, period_s: float) -> float:
    """The travel of first contact, m, from travels (n,) and contact wrenches (n, 6) whose last one is at the threshold.

    The force along its own final direction is free air (zero) before contact and a straight line after it, which may
    start with a jump, because damping in the joints resists at once and stiffness only with travel. The change is put
    where the two fit best (least squares change point), near where the force left the noise for good.
    """
    window = max(4, round(ONSET_S / period_s))
    direction = contacts[-3:, :3].mean(axis=0)
    direction = direction / max(float(np.linalg.norm(direction)), 1e-9)
    along = contacts[:, :3] @ direction
    noise = float(np.std(along[:window])) if len(along) > 2 * window else 0.1
    above = along > max(5.0 * noise, 0.3)
    first = len(along) - 1
    while first > 0 and above[first - 1]:
        first -= 1
    low, high = max(0, first - window), min(len(along), first + window)
    best, best_cost = first, float("inf")
    for change in range(low, first + 1):
        cost = float(along[low:change] @ along[low:change]) + _line_misfit(along[change:high])
        if cost < best_cost:
            best, best_cost = change, cost
    return 0.5 * (float(travels_m[max(0, best - 1)]) + float(travels_m[best]))


def _line_misfit(values: Array) -> float:
    """The squared residual of the best straight line through equally spaced values."""
    count = len(values)
    if count < 3:
        return 0.0
    steps = np.arange(count) - 0.5 * (count - 1)
    level = values.mean()
    slope = (steps @ values) / (steps @ steps)
    residual = values - level - slope * steps
    return float(residual @ residual)
