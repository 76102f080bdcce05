"""The way back where too much is felt, along the way that was come."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rows import rows_of
from services.hardware.control.cycle import CycleReading, Reference, finite_difference_speed
from services.hardware.control.runner import Runner

BACK_OFF_RAD_S = 0.04  # of the joint that turns most: some 20 mm/s at the peg
BACK_OFF_RAD_S2 = 2.0
LOOK_S = 0.03  # at rest, before what is felt counts
SLOW_FILTER_S = 0.0095
Load = tuple[float, float]  # N, Nm


def back_off(runner: Runner, small: Load, worse: Load) -> Generator[Reference, CycleReading, None]:
    """Back along the way it came, at up to 20 mm/s, until little is felt or the way is at its end.

    A wedged peg may be held on its way back too: where the load grows by `worse` above the least that was felt, the arm
    goes to where that was and stands.
    """
    trail = runner.trail
    speed = _Ramp(runner.period_s)
    smoothing = 1.0 - float(np.exp(-runner.period_s / SLOW_FILTER_S))
    free = False
    while trail and not free:
        felt: Array | None = None
        least, where = np.full(2, np.inf), runner.joints_rad
        while trail and (felt is None or np.any(felt > small)):
            reading = yield _towards(runner, trail.back(runner.joints_rad, speed.faster()))
            load = np.array([reading.force_n, reading.moment_nm])
            felt = load if felt is None else felt + smoothing * (load - felt)
            if np.all(felt <= least):
                where = runner.joints_rad
            least = np.minimum(least, felt)
            if np.any(felt > least + worse):
                speed.stop()
                while not np.array_equal(runner.joints_rad, where):
                    yield _towards(runner, _step(runner.joints_rad, where, speed.faster()))
                trail.append(runner.joints_rad)
                return
        while trail and speed.moves:
            yield _towards(runner, trail.back(runner.joints_rad, speed.slower()))
        # A vibration must not pass for freedom: look again at rest.
        loads = []
        count = max(3, round(LOOK_S / runner.period_s))
        for _ in range(count):
            reading = yield replace(runner.still(), retracing=True)
            loads.append((reading.force_n, reading.moment_nm))
        free = bool(np.all(np.mean(loads[-max(1, count // 3) :], axis=0) <= small))
    trail.append(runner.joints_rad)


class _Ramp:
    """How far a cycle goes: gathered and lost gently, for the payload's inertia is felt as force."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._rad_s = 0.0

    @property
    def moves(self) -> bool:
        """Whether it still has speed to lose."""
        return self._rad_s > 0.0

    def faster(self) -> float:
        """The way of the next cycle, rad of the joint that turns most."""
        self._rad_s = min(BACK_OFF_RAD_S, self._rad_s + BACK_OFF_RAD_S2 * self._period_s)
        return self._rad_s * self._period_s

    def slower(self) -> float:
        """The way of the next cycle on the way to rest."""
        self._rad_s = max(0.0, self._rad_s - BACK_OFF_RAD_S2 * self._period_s)
        return self._rad_s * self._period_s

    def stop(self) -> None:
        """At rest; a turn round begins from there."""
        self._rad_s = 0.0


def _step(before_rad: Array, target_rad: Array, budget_rad: float) -> Array:
    far = float(np.abs(target_rad - before_rad).max())
    return target_rad if far <= budget_rad else np.asarray(before_rad + (target_rad - before_rad) * (budget_rad / far))


def _towards(runner: Runner, target_rad: Array) -> Reference:
    speeds = finite_difference_speed(runner.joints_rad, target_rad, runner.period_s)
    return Reference(target_rad, speeds, rows_of(runner.forward(target_rad).rotation), retracing=True)
