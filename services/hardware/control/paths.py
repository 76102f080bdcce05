"""Ways for the motor side: quintic joint trajectories and straight lines, checked as a whole before anything moves.

Raises `CommandRefused` with code `not_finite`, `joint_limit`, `speed_limit`, `acceleration_limit`, `wrong_start`,
`knots` or `unreachable`; the text names joint and knot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import numpy as np
from scipy.interpolate import BPoly, CubicSpline, PPoly

from crosspih_common.arm import ArmModel
from crosspih_common.arm.inverse import InverseError, track
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages.motion import JointKnot

START_TOLERANCE_RAD = 0.01
_LIMIT_SLACK = 1.001
_NODE_M = 1e-3
_NODE_RAD = 0.01


def refuse_not_finite(name: str, values: Sequence[float] | Array) -> None:
    """Messages check this on the wire; a caller in the same process may not have."""
    if not np.all(np.isfinite(np.asarray(values, float))):
        raise CommandRefused("not_finite", f"{name} holds {list(values)}, want finite numbers")


def refuse_longer(name: str, duration_s: float, most_s: float) -> None:
    """A motion that would take too long is refused before any work is done for it."""
    if not duration_s <= most_s:
        raise CommandRefused(
            "size", f"{name}: the motion would take {duration_s:.4g} s, {most_s:g} s are allowed; send it in parts"
        )


def unit_direction(name: str, vector: Sequence[float]) -> Array:
    """A direction (3,) made a unit vector."""
    refuse_not_finite(name, vector)
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise CommandRefused("direction", f"{name} has no length; give a vector that points somewhere")
    return np.asarray(vector, float) / length


class TimedPath(Protocol):
    """A way from rest to rest, parametrised by time."""

    @property
    def duration_s(self) -> float:
        """From its start to its end."""

    def samples(self, times_s: Array) -> Iterator[tuple[Array, Array]]:
        """Joints (n,) and their speeds (n,) at each of some times (k,), s."""


class JointPath:
    """Quintic segments through knots (the paper's Eqs. 10 and 11, as Bernstein polynomials)."""

    def __init__(self, arm: ArmModel, knots: Sequence[JointKnot], joints_now_rad: Array) -> None:
        for index, knot in enumerate(knots):
            if not len(knot.joints_rad) == len(knot.speeds_rad_s) == len(knot.accelerations_rad_s2) == arm.joints:
                raise CommandRefused(
                    "joints", f"knot {index} has {len(knot.joints_rad)} joints, the arm {arm.name} has {arm.joints}"
                )
        times = np.array([knot.time_s for knot in knots])
        joints = np.array([knot.joints_rad for knot in knots], dtype=float)
        speeds = np.array([knot.speeds_rad_s for knot in knots], dtype=float)
        accelerations = np.array([knot.accelerations_rad_s2 for knot in knots], dtype=float)
        for index, knot in enumerate(knots):
            refuse_not_finite(f"knot {index}", [knot.time_s, *joints[index], *speeds[index], *accelerations[index]])
        if len(knots) < 2 or np.any(np.diff(times) < 1e-3):
            raise CommandRefused("knots", "knot times must rise by at least 1 ms from knot to knot")
        for index, name in ((0, "first"), (len(knots) - 1, "last")):
            if np.any(np.abs(speeds[index]) > 1e-6):
                raise CommandRefused("knots", f"the {name} knot ({index}) must be at rest: its speeds_rad_s are not 0")
        off = np.abs(joints[0] - joints_now_rad)
        if off.max() > START_TOLERANCE_RAD:
            joint = int(off.argmax())
            raise CommandRefused(
                "wrong_start",
                f"knot 0 is not where the arm is: joint {joint + 1} at {joints_now_rad[joint]:.4f} rad, the knot says "
                f"{joints[0, joint]:.4f} (tolerance {START_TOLERANCE_RAD} rad); plan from the present joint state",
            )
        joints[0] = joints_now_rad
        values = np.stack([joints, speeds, accelerations], axis=1)
        self._position = PPoly.from_bernstein_basis(BPoly.from_derivatives(times - times[0], values))
        self._speed = self._position.derivative()
        self._acceleration = self._speed.derivative()
        self.duration_s: float = float(times[-1] - times[0])
        self._check(arm, times - times[0])

    def _check(self, arm: ArmModel, times: Array) -> None:
        limits = arm.limits
        for index in range(len(times) - 1):
            grid = np.linspace(times[index], times[index + 1], 65)
            where = f"between knots {index} and {index + 1}"
            _check_range(arm, self._position(grid), where)
            for name, unit, values, limit in (
                ("speed", "rad/s", self._speed(grid), limits.speed_rad_s),
                ("acceleration", "rad/s^2", self._acceleration(grid), limits.acceleration_rad_s2),
            ):
                excess = np.abs(values).max(axis=0) / limit
                if excess.max() > _LIMIT_SLACK:
                    joint = int(excess.argmax())
                    raise CommandRefused(
                        f"{name}_limit",
                        f"joint {joint + 1} would need {np.abs(values[:, joint]).max():.3f} {unit} {where}, its limit "
                        f"is {limit[joint]:.3f}; give the segment more time",
                    )

    def positions(self, times_s: Array) -> Array:
        """Joints (k, n) at times (k,) from the first knot, s."""
        return np.asarray(self._position(times_s))

    def samples(self, times_s: Array) -> Iterator[tuple[Array, Array]]:
        """As TimedPath."""
        return zip(self._position(times_s), self._speed(times_s), strict=True)


class StraightPath:
    """A way of the peg frame from a pose, parametrised by s in [0, length]; joints by closed form and spline.

    Nodes every millimetre or 10 mrad: the spline is then off by less than a nanometre.
    """

    def __init__(
        self, arm: ArmModel, pose_flange_peg: Pose, pose_at: Callable[[float], Pose], length: float, nodes: int,
        seed_joints_rad: Array,
    ) -> None:  # fmt: skip
        self.pose_at = pose_at
        self.length = length
        peg_to_flange = pose_flange_peg.inverse()
        grid = np.linspace(0.0, length, max(4, nodes + 1))
        try:
            joints = track(arm, (pose_at(float(s)) @ peg_to_flange for s in grid), seed_joints_rad)
        except InverseError as error:
            raise CommandRefused("unreachable", f"the straight path cannot be followed: {error}") from error
        if np.abs(joints[0] - seed_joints_rad).max() > START_TOLERANCE_RAD:
            raise CommandRefused("unreachable", "the straight path would start with a jump of the joints")
        # The arm stands where it stands: take the last digits of rounding off the whole path.
        joints = joints + (seed_joints_rad - joints[0])
        _check_range(arm, joints, "on the straight path")
        spline = CubicSpline(grid, joints, axis=0)
        self._coefficients = np.ascontiguousarray(np.moveaxis(spline.c, 1, 0))
        self._spacing = float(grid[1])
        self._last = len(grid) - 2
        slope = np.abs(spline(grid, 1)).max(axis=0)
        curve = np.abs(spline(grid, 2)).max(axis=0)
        self._limits, self._slope, self._curve = arm.limits, slope, curve

    def at(self, s: float) -> tuple[Array, Array]:
        """Joints and their derivative by s, each (n,)."""
        index = min(self._last, max(0, int(s / self._spacing)))
        t = s - index * self._spacing
        a, b, c, d = self._coefficients[index]
        return ((a * t + b) * t + c) * t + d, (3.0 * a * t + 2.0 * b) * t + c

    def at_all(self, s: Array) -> tuple[Array, Array]:
        """The same (k, n) at places (k,)."""
        index = np.clip((s / self._spacing).astype(int), 0, self._last)
        t = (s - index * self._spacing)[:, None]
        a, b, c, d = self._coefficients[index].swapaxes(0, 1)
        return ((a * t + b) * t + c) * t + d, (3.0 * a * t + 2.0 * b) * t + c

    def joints(self, count: int) -> Array:
        """Joints (count, n) at places evenly along the way."""
        return self.at_all(np.linspace(0.0, self.length, count))[0]

    def check_speed(self, rate: float) -> None:
        """Refuse a rate of s (1/s) that some joint could not follow somewhere on the way."""
        need = self._slope * rate
        excess = need / self._limits.speed_rad_s
        if excess.max() > 1.0:
            joint = int(excess.argmax())
            raise CommandRefused(
                "speed_limit",
                f"joint {joint + 1} would need {need[joint]:.3f} rad/s on the straight path, its limit is "
                f"{self._limits.speed_rad_s[joint]:.3f}; go slower or stay away from the singularity",
            )

    def shortest_s(self, duration_s: float) -> float:
        """A duration for a quintic from rest to rest that also keeps every joint inside speed and acceleration."""
        rate_peak, rate_change = 1.875 * self.length, 5.7736 * self.length
        by_speed = np.max(self._slope * rate_peak / self._limits.speed_rad_s)
        by_change = np.max(
            np.sqrt((self._slope * rate_change + self._curve * rate_peak**2) / self._limits.acceleration_rad_s2)
        )
        return float(max(duration_s, by_speed, by_change))


class LineInTime:
    """A straight path gone along by a quintic in time, from rest to rest."""

    def __init__(self, path: StraightPath, duration_s: float) -> None:
        self._path, self.duration_s = path, duration_s

    def _places(self, times_s: Array) -> Array:
        x = times_s / self.duration_s
        return np.asarray(self._path.length * x**3 * (10.0 - 15.0 * x + 6.0 * x * x))

    def positions(self, times_s: Array) -> Array:
        """Joints (k, n) at times (k,), s."""
        return self._path.at_all(self._places(times_s))[0]

    def samples(self, times_s: Array) -> Iterator[tuple[Array, Array]]:
        """As TimedPath."""
        x = times_s / self.duration_s
        rates = self._path.length * 30.0 * x * x * (1.0 - x) ** 2 / self.duration_s
        joints, slopes = self._path.at_all(self._places(times_s))
        return zip(joints, slopes * rates[:, None], strict=True)


def line(
    arm: ArmModel, pose_flange_peg: Pose, start: Pose, direction_base: Array, length_m: float, joints_rad: Array
) -> StraightPath:
    """Along a direction, orientation kept; s in metres."""

    def pose_at(s: float) -> Pose:
        return Pose(start.rotation, start.translation_m + direction_base * s)

    return StraightPath(arm, pose_flange_peg, pose_at, length_m, int(np.ceil(length_m / _NODE_M)), joints_rad)


def between(arm: ArmModel, pose_flange_peg: Pose, start: Pose, end: Pose, joints_rad: Array) -> StraightPath:
    """From pose to pose, orientation turned along; s from 0 to 1."""
    turn = Pose(start.rotation.T @ end.rotation, np.zeros(3)).rotvec_rad()
    shift = end.translation_m - start.translation_m

    def pose_at(s: float) -> Pose:
        rotation = start.rotation @ Pose.from_rotvec(turn * s, np.zeros(3)).rotation
        return Pose(rotation, start.translation_m + shift * s)

    nodes = int(np.ceil(max(float(np.linalg.norm(shift)) / _NODE_M / 4.0, float(np.linalg.norm(turn)) / _NODE_RAD)))
    return StraightPath(arm, pose_flange_peg, pose_at, 1.0, nodes, joints_rad)


def _check_range(arm: ArmModel, joints_rad: Array, where: str) -> None:
    low, high = arm.limits.lower_rad, arm.limits.upper_rad
    outside = np.maximum(low - joints_rad, joints_rad - high)
    if outside.max() > 1e-6:
        row, joint = np.unravel_index(int(outside.argmax()), outside.shape)
        raise CommandRefused(
            "joint_limit",
            f"joint {joint + 1} would be at {joints_rad[row, joint]:.4f} rad {where}, outside "
            f"[{low[joint]:.4f}, {high[joint]:.4f}]",
        )
