"""Quintic joint motion: coefficients, evaluation, exact peaks, and a trajectory of knots joined by quintics.

Position, velocity and acceleration are continuous throughout: each piece meets the six boundary values of its two
knots (the paper's Eqs. 10-11, with the last line of Eq. 10 read as 12 a4 T^2 + 20 a5 T^3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.arm.kinematics import JointLimits
from crosspih_common.geometry.pose import Array

REST_PEAK_SPEED = 15.0 / 8.0
"""Peak speed of a rest-to-rest quintic, in units of distance / duration."""
REST_PEAK_ACCELERATION = 10.0 / np.sqrt(3.0)
"""Peak acceleration of a rest-to-rest quintic, in units of distance / duration^2."""


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """One instant of a motion: position (n,) rad, velocity (n,) rad/s, acceleration (n,) rad/s^2."""

    position_rad: Array
    velocity_rad_s: Array
    acceleration_rad_s2: Array

    def __post_init__(self) -> None:
        for name in ("position_rad", "velocity_rad_s", "acceleration_rad_s2"):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.ndim != 1 or value.shape != np.shape(self.position_rad) or not np.all(np.isfinite(value)):
                raise ValueError(f"{name} wants one finite number a joint, got {value!r}")
            object.__setattr__(self, name, value)

    @classmethod
    def at_rest(cls, joints_rad: ArrayLike) -> JointSample:
        """Standing still at joint angles (n,), rad."""
        joints = np.array(joints_rad, dtype=float)
        return cls(joints, np.zeros(joints.shape), np.zeros(joints.shape))


def _coefficients(start: tuple[Array, Array, Array], goal: tuple[Array, Array, Array], duration_s: Array) -> Array:
    """Eq. 11 for any number of quintics: (6 powers, ...) of boundary values (...), durations broadcast to them."""
    q0, v0, acc0 = start
    q1, v1, acc1 = goal
    t, dq = duration_s, q1 - q0
    a3 = (20.0 * dq - (8.0 * v1 + 12.0 * v0) * t + (acc1 - 3.0 * acc0) * t**2) / (2.0 * t**3)
    a4 = (-30.0 * dq + (14.0 * v1 + 16.0 * v0) * t - (2.0 * acc1 - 3.0 * acc0) * t**2) / (2.0 * t**4)
    a5 = (12.0 * dq - 6.0 * (v1 + v0) * t + (acc1 - acc0) * t**2) / (2.0 * t**5)
    return np.array([q0, v0, acc0 / 2.0, a3, a4, a5])


def _derivative(coefficients: Array, order: int) -> Array:
    rows = coefficients
    for _ in range(order):
        rows = rows[1:] * np.arange(1, len(rows))[:, None]
    return rows


def _value(coefficients: Array, times: Array) -> Array:
    """Polynomials (powers, m) at times (k, m), by Horner's rule."""
    value = np.zeros_like(times)
    for row in coefficients[::-1]:
        value = value * times + row
    return value


def _extremes(coefficients: Array, durations_s: Array, order: int) -> tuple[Array, Array]:
    """The least and greatest value (m,) on 0 .. duration (m,) of a derivative of polynomials (6 powers, m).

    At the ends and at the roots of the next derivative: eigenvalues of companion matrices, polished by Newton's method.
    """
    # In units of the duration and of the greatest coefficient, so that the root finder sees well-scaled numbers.
    values = _derivative(coefficients, order)
    values = values * durations_s ** np.arange(len(values))[:, None]
    slopes = _derivative(values, 1)
    size = np.max(np.abs(slopes), axis=0)
    slopes = slopes / np.where(size > 0.0, size, 1.0)
    degree = len(slopes) - 1
    # A vanishing leading coefficient is held off zero: its spurious root lies far outside, the others hardly move.
    lead = np.where(np.abs(slopes[-1]) < 1e-10, 1e-10, slopes[-1])
    companion = np.zeros((slopes.shape[1], degree, degree))
    companion[:, 0, :] = (-slopes[-2::-1] / lead).T
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    # A double root splits into a complex pair by rounding: evaluating at its real part costs nothing.
    roots = np.clip(np.real(np.linalg.eigvals(companion)).T, 0.0, 1.0)
    polished, bends = roots, _derivative(slopes, 1)
    for _ in range(3):
        bend = _value(bends, polished)
        step = _value(slopes, polished) / np.where(np.abs(bend) > 1e-9, bend, np.inf)
        polished = np.clip(polished - step, 0.0, 1.0)
    ends = np.array([[0.0], [1.0]]) * np.ones(slopes.shape[1])
    reached = _value(values, np.concatenate([ends, roots, polished]))
    return reached.min(axis=0), reached.max(axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class Quintic:
    """The joints' polynomials q(t) = sum of coefficients[k] t^k, 0 <= t <= duration_s; coefficients (6 powers, n)."""

    coefficients: Array
    duration_s: float

    @classmethod
    def between(cls, start: JointSample, goal: JointSample, duration_s: float) -> Quintic:
        """The quintic with both samples as its boundary values (Eq. 11); ValueError unless 0 < duration_s < inf."""
        t = float(duration_s)
        if not 0.0 < t < np.inf:
            raise ValueError(f"duration_s wants a positive finite number, got {duration_s}")
        return cls(
            _coefficients(
                (start.position_rad, start.velocity_rad_s, start.acceleration_rad_s2),
                (goal.position_rad, goal.velocity_rad_s, goal.acceleration_rad_s2),
                np.array(t),
            ),
            t,
        )

    def derivative(self, order: int) -> Array:
        """The coefficients (6 - order, n) of a time derivative."""
        return _derivative(self.coefficients, order)

    def sample(self, time_s: float) -> JointSample:
        """The motion at a time, clamped to 0 .. duration_s."""
        t = min(max(float(time_s), 0.0), self.duration_s)
        return JointSample(*(t ** np.arange(6 - order) @ self.derivative(order) for order in range(3)))

    def extremes(self, order: int) -> tuple[Array, Array]:
        """The exact least and greatest value, each (n,), of position (0), velocity (1) or acceleration (2)."""
        return _extremes(self.coefficients, np.full(self.coefficients.shape[1], self.duration_s), order)

    def peak(self, order: int) -> Array:
        """The exact greatest magnitude (n,) of velocity (order 1) or acceleration (order 2)."""
        low, high = self.extremes(order)
        return np.maximum(np.abs(low), np.abs(high))


@dataclass(frozen=True, slots=True, eq=False)
class JointTrajectory:
    """Knots joined by quintics: times (k,) s from 0, rising; positions, velocities, accelerations (k, n)."""

    times_s: Array
    positions_rad: Array
    velocities_rad_s: Array
    accelerations_rad_s2: Array

    def __post_init__(self) -> None:
        times = np.asarray(self.times_s, dtype=float)
        if times.ndim != 1 or len(times) < 2 or times[0] != 0.0 or not np.all(np.diff(times) > 0.0):
            raise ValueError("times_s wants at least two times, the first 0, each later than the one before")
        object.__setattr__(self, "times_s", times)
        for name in ("positions_rad", "velocities_rad_s", "accelerations_rad_s2"):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (len(times), self.joints) or not np.all(np.isfinite(value)):
                raise ValueError(
                    f"{name} wants shape ({len(times)}, {self.joints}) and finite numbers, got {value.shape}"
                )
            object.__setattr__(self, name, value)

    @classmethod
    def from_samples(cls, times_s: ArrayLike, samples: list[JointSample]) -> JointTrajectory:
        """From the instants the motion passes through."""
        return cls(
            np.asarray(times_s, dtype=float),
            np.array([sample.position_rad for sample in samples]),
            np.array([sample.velocity_rad_s for sample in samples]),
            np.array([sample.acceleration_rad_s2 for sample in samples]),
        )

    @property
    def joints(self) -> int:
        """How many joints move."""
        return int(np.shape(self.positions_rad)[-1])

    @property
    def duration_s(self) -> float:
        """From the first knot to the last."""
        return float(self.times_s[-1])

    def knot(self, index: int) -> JointSample:
        """One knot."""
        return JointSample(self.positions_rad[index], self.velocities_rad_s[index], self.accelerations_rad_s2[index])

    def piece(self, index: int) -> Quintic:
        """The quintic from knot `index` to the next."""
        return Quintic.between(
            self.knot(index), self.knot(index + 1), float(self.times_s[index + 1] - self.times_s[index])
        )

    def sample(self, time_s: float) -> JointSample:
        """The motion at a time, clamped to the trajectory's own span."""
        t = min(max(float(time_s), 0.0), self.duration_s)
        index = min(int(np.searchsorted(self.times_s, t, side="right")) - 1, len(self.times_s) - 2)
        return self.piece(index).sample(t - float(self.times_s[index]))

    def sampled(self, period_s: float) -> JointTrajectory:
        """The same motion with knots every `period_s` (s), the last one at the very end."""
        if not period_s > 0.0:
            raise ValueError(f"period_s wants a positive number, got {period_s}")
        count = max(1, int(np.ceil(self.duration_s / period_s - 1e-9)))
        times = np.append(np.arange(count) * period_s, self.duration_s)
        return JointTrajectory.from_samples(times, [self.sample(t) for t in times])

    def stretched(self, factor: float) -> JointTrajectory:
        """The same path at 1 / factor of the speed; factor > 0."""
        if not factor > 0.0:
            raise ValueError(f"factor wants a positive number, got {factor}")
        return JointTrajectory(
            self.times_s * factor,
            self.positions_rad,
            self.velocities_rad_s / factor,
            self.accelerations_rad_s2 / factor**2,
        )

    def peaks(self) -> tuple[Array, Array]:
        """The exact greatest speed (n,), rad/s, and acceleration (n,), rad/s^2, of each joint."""
        speed_low, speed_high = self._range(1)
        acceleration_low, acceleration_high = self._range(2)
        return (
            np.maximum(np.abs(speed_low), np.abs(speed_high)),
            np.maximum(np.abs(acceleration_low), np.abs(acceleration_high)),
        )

    def _range(self, order: int) -> tuple[Array, Array]:
        """The exact least and greatest value (n,) of position (0), velocity (1) or acceleration (2)."""
        states = (self.positions_rad, self.velocities_rad_s, self.accelerations_rad_s2)
        spans = np.diff(self.times_s)[:, None] * np.ones(self.joints)
        start, goal = (tuple(state[part] for state in states) for part in (slice(None, -1), slice(1, None)))
        coefficients = _coefficients((start[0], start[1], start[2]), (goal[0], goal[1], goal[2]), spans)
        low, high = _extremes(coefficients.reshape(6, -1), spans.ravel(), order)
        return low.reshape(-1, self.joints).min(axis=0), high.reshape(-1, self.joints).max(axis=0)

    def violations(self, limits: JointLimits) -> list[str]:
        """One line for each limit that the motion crosses anywhere, also between knots; empty when it crosses none."""
        low, high = self._range(0)
        lines = [*limits.violations(low), *limits.violations(high)]
        speed, acceleration = self.peaks()
        for joint in range(self.joints):
            if speed[joint] > limits.speed_rad_s[joint] * (1.0 + 1e-9):
                lines.append(
                    f"joint {joint + 1} reaches {speed[joint]:.4f} rad/s, its limit is {limits.speed_rad_s[joint]:.4f}"
                )
            if acceleration[joint] > limits.acceleration_rad_s2[joint] * (1.0 + 1e-9):
                lines.append(
                    f"joint {joint + 1} reaches {acceleration[joint]:.4f} rad/s^2, "
                    f"its limit is {limits.acceleration_rad_s2[joint]:.4f}"
                )
        return list(dict.fromkeys(lines))
