"""Motions as generators: each yields where the motor side is to be next and is sent what was felt there.

A motion ends by returning why. It does not know of caps and stops: whoever runs it cuts it short (arm.py).
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import StopReason
from services.hardware.control.paths import JointTrajectory, StraightPath
from services.hardware.control.servo import TRAIL_STEP_RAD, Reading, Reference, Servo, finite_difference_speed
from services.hardware.drivers.simulated.engines.pybullet.engine import STEP_S

SETTLE_STEPS = 30
SLOW_FILTER = 0.1
_POSE_EVERY = 5


@dataclass(frozen=True, slots=True)
class Ending:
    """Why a motion ended."""

    reason: StopReason
    detail: str = ""


Steps = Generator[Reference, Reading, Ending]
Load = tuple[float, float]  # N, Nm


class Motion(Protocol):
    """One commanded motion."""

    def steps(self, servo: Servo) -> Steps:
        """Run it, a millisecond at a time."""


class Follow:
    """Along a joint trajectory, then still for 30 ms."""

    def __init__(self, trajectory: JointTrajectory) -> None:
        self._trajectory = trajectory

    def steps(self, servo: Servo) -> Steps:
        """Gravity on the sensor turns slowly enough to look at the orientation every 5 ms."""
        count = int(np.ceil(self._trajectory.duration_s / STEP_S - 1e-9))
        times = np.minimum(np.arange(1, count + 1) * STEP_S, self._trajectory.duration_s)
        joints, speeds, accelerations = self._trajectory.samples(times)
        for index in range(count):
            pose = servo.forward(joints[index]) if index % _POSE_EVERY == 0 or index == count - 1 else None
            yield Reference(joints[index], speeds[index], accelerations[index], pose)
        for _ in range(SETTLE_STEPS):
            yield servo.still()
        return Ending(StopReason.COMPLETED)


class Linear:
    """Along a straight path by a quintic in time, then still for 30 ms."""

    def __init__(self, path: StraightPath, duration_s: float) -> None:
        self._path = path
        self._duration_s = duration_s

    def steps(self, servo: Servo) -> Steps:
        """From rest to rest."""
        count = max(1, int(np.ceil(self._duration_s / STEP_S)))
        duration, length = count * STEP_S, self._path.length
        for index in range(1, count + 1):
            x = index / count
            s = length * x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
            rate = length * 30.0 * x * x * (1.0 - x) ** 2 / duration
            change = length * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / duration**2
            joints, slope, curve = self._path.at(s)
            yield Reference(joints, slope * rate, slope * change + curve * rate * rate, self._path.pose_at(s))
        for _ in range(SETTLE_STEPS):
            yield servo.still()
        return Ending(StopReason.COMPLETED)


class Hold:
    """Still, averaging the sensor over all but the first settling samples."""

    def __init__(self, duration_s: float) -> None:
        self._count = max(1, round(duration_s / STEP_S))
        self._skip = min(SETTLE_STEPS, self._count // 2)
        self.samples: list[Array] = []

    def steps(self, servo: Servo) -> Steps:
        """For the duration."""
        for index in range(self._count):
            reading = yield servo.still()
            if index >= self._skip:
                self.samples.append(reading.raw)
        return Ending(StopReason.COMPLETED)


def brake(servo: Servo, limits_rad_s2: Array) -> Generator[Reference, Reading, None]:
    """To rest as fast as the joints' limits allow, all joints together, from whatever the last step's speed was."""
    speeds = servo.speeds_rad_s
    count = int(np.ceil(float(np.max(np.abs(speeds) / limits_rad_s2)) / STEP_S - 1e-9))
    for index in range(1, count + 1):
        slower = speeds * (1.0 - index / count)
        joints = servo.joints_rad + slower * STEP_S
        yield Reference(joints, slower, np.zeros(6), servo.forward(joints))


def back_off(servo: Servo, small: Load, worse: Load) -> Generator[Reference, Reading, None]:
    """Back along the way it came, at up to 20 mm/s, until little is felt or the way is at its end.

    A wedged peg may be held on its way back too: where the load grows by `worse` above the least that was felt, the arm
    goes to where that was and stands.
    """
    trail = servo.trail
    free = False
    while trail and not free:
        felt: Array | None = None
        least, where = np.full(2, np.inf), servo.joints_rad
        while trail and (felt is None or np.any(felt > small)):
            reading = yield _towards(servo, trail[-1])
            if np.array_equal(servo.joints_rad, trail[-1]):
                trail.pop()
            load = np.array([reading.force_n, reading.moment_nm])
            felt = load if felt is None else felt + SLOW_FILTER * (load - felt)
            if np.all(felt <= least):
                where = servo.joints_rad
            least = np.minimum(least, felt)
            if np.any(felt > least + worse):
                while not np.array_equal(servo.joints_rad, where):
                    yield _towards(servo, where)
                trail.append(servo.joints_rad)
                return
        # A vibration must not pass for freedom: look again at rest.
        loads = []
        for _ in range(SETTLE_STEPS):
            reading = yield replace(servo.still(), retracing=True)
            loads.append((reading.force_n, reading.moment_nm))
        free = bool(np.all(np.mean(loads[-10:], axis=0) <= small))
    trail.append(servo.joints_rad)


def _towards(servo: Servo, target: Array) -> Reference:
    """A step of the way to a joint position, at most TRAIL_STEP_RAD of any joint."""
    before = servo.joints_rad
    far = float(np.abs(target - before).max()) / TRAIL_STEP_RAD
    if far > 1.0:
        target = before + (target - before) / far
    return Reference(
        target, finite_difference_speed(before, target), np.zeros(6), servo.forward(target), retracing=True
    )
