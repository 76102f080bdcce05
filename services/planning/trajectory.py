"""Joint and straight-line motions inside speed and acceleration limits, as quintics (the paper's Eqs. 10-11).

A rest-to-rest quintic over a distance dq in time T peaks at 1.875 dq / T and 5.7735 dq / T^2, so its shortest duration
is known in closed form. Between moving boundary states it is found by search. A straight line in space becomes
knots of a joint trajectory, whose exact peaks then set its duration.

Errors: `TrajectoryError` (ValueError), no such motion exists inside the limits; the message names the joint.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from crosspih_common.arm.inverse import track
from crosspih_common.arm.kinematics import ArmModel, JointLimits
from crosspih_common.arm.quintic import (
    REST_PEAK_ACCELERATION,
    REST_PEAK_SPEED,
    JointSample,
    JointTrajectory,
    Quintic,
)
from crosspih_common.geometry.pose import Array, Pose

_SHORTEST_S = 0.02
_LONGEST_S = 60.0


class TrajectoryError(ValueError):
    """No such motion exists inside the limits."""


def scaled_limits(limits: JointLimits, speed_scale: float, acceleration_scale: float | None = None) -> JointLimits:
    """The limits with a fraction (0..1] of the speeds and accelerations; the ranges stay."""
    acceleration_scale = speed_scale if acceleration_scale is None else acceleration_scale
    for name, scale in (("speed_scale", speed_scale), ("acceleration_scale", acceleration_scale)):
        if not 0.0 < scale <= 1.0:
            raise ValueError(f"{name} wants a number in (0, 1], got {scale}")
    return replace(
        limits,
        speed_rad_s=limits.speed_rad_s * speed_scale,
        acceleration_rad_s2=limits.acceleration_rad_s2 * acceleration_scale,
    )


def rest_duration_s(distance_rad: ArrayLike, limits: JointLimits) -> float:
    """The shortest duration (s) of a rest-to-rest quintic over joint distances (n,), rad, inside the limits."""
    distance = np.abs(np.asarray(distance_rad, dtype=float))
    by_speed = REST_PEAK_SPEED * distance / limits.speed_rad_s
    by_acceleration = np.sqrt(REST_PEAK_ACCELERATION * distance / limits.acceleration_rad_s2)
    return max(_SHORTEST_S, float(np.max(by_speed)), float(np.max(by_acceleration)))


def move_joints(start_rad: ArrayLike, goal_rad: ArrayLike, limits: JointLimits) -> JointTrajectory:
    """The fastest rest-to-rest quintic from joints (n,) to joints (n,), rad, all arriving together.

    Raises `TrajectoryError` when either end lies outside the range of a joint (between them the motion is monotone).
    """
    start, goal = JointSample.at_rest(start_rad), JointSample.at_rest(goal_rad)
    for name, sample in (("start_rad", start), ("goal_rad", goal)):
        lines = limits.violations(sample.position_rad)
        if lines:
            raise TrajectoryError(f"{name}: " + "; ".join(lines))
    duration = rest_duration_s(goal.position_rad - start.position_rad, limits)
    return JointTrajectory.from_samples([0.0, duration], [start, goal])


def move_through(waypoints_rad: ArrayLike, limits: JointLimits) -> JointTrajectory:
    """Through waypoints (k, n), rad, at rest in each; waypoints equal to the one before are passed over."""
    points = np.asarray(waypoints_rad, dtype=float)
    joints = len(limits.lower_rad)
    if points.ndim != 2 or points.shape[1] != joints or len(points) < 2:
        raise ValueError(f"waypoints_rad wants shape (k, {joints}) with k >= 2, got {points.shape}")
    legs = [move_joints(a, b, limits) for a, b in pairwise(points) if np.max(np.abs(b - a)) > 1e-12]
    return joined(legs) if legs else move_joints(points[0], points[-1], limits)


def connect(start: JointSample, goal: JointSample, limits: JointLimits) -> JointTrajectory:
    """The fastest single quintic between two moving states, inside range, speed and acceleration, found by search.

    Feasibility is not monotone in the duration (a slow quintic with a moving boundary swings wide), so durations
    are scanned from a lower bound in steps of 5 %, and the first feasible one is refined by bisection.
    Raises `TrajectoryError` with what forbids the last duration tried, or the boundary state that breaks a limit.
    """

    def lines_at(duration_s: float) -> list[str]:
        return JointTrajectory.from_samples([0.0, duration_s], [start, goal]).violations(limits)

    for name, sample in (("start", start), ("goal", goal)):
        lines = limits.violations(sample.position_rad)
        lines += [
            f"joint {joint + 1} is asked for {word}"
            for joint in range(len(limits.lower_rad))
            for word, value, limit in (
                ("too much speed", sample.velocity_rad_s, limits.speed_rad_s),
                ("too much acceleration", sample.acceleration_rad_s2, limits.acceleration_rad_s2),
            )
            if abs(value[joint]) > limit[joint] * (1.0 + 1e-9)
        ]
        if lines:
            raise TrajectoryError(f"{name}: " + "; ".join(lines))
    distance = np.abs(goal.position_rad - start.position_rad)
    low = max(_SHORTEST_S, float(np.max(distance / limits.speed_rad_s)))
    high = low
    lines = lines_at(high)
    while lines:
        low, high = high, high * 1.05
        if high > _LONGEST_S:
            raise TrajectoryError("no duration brings this quintic inside the limits: " + "; ".join(lines[:2]))
        lines = lines_at(high)
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        if lines_at(middle):
            low = middle
        else:
            high = middle
    return JointTrajectory.from_samples([0.0, high], [start, goal])


def straight_poses(start: Pose, goal: Pose, fractions: ArrayLike) -> list[Pose]:
    """Poses on the straight line from start to goal at fractions (n,) of 0..1, turning about one fixed axis."""
    fraction = np.atleast_1d(np.asarray(fractions, dtype=float))
    turn = Rotation.from_matrix(start.rotation.T @ goal.rotation).as_rotvec()
    turned = start.rotation @ Rotation.from_rotvec(fraction[:, None] * turn).as_matrix()
    places = start.translation_m + fraction[:, None] * (goal.translation_m - start.translation_m)
    return [Pose(rotation, place) for rotation, place in zip(turned, places, strict=True)]


def move_line(
    arm: ArmModel,
    start_rad: ArrayLike,
    goal_base_point: Pose,
    limits: JointLimits,
    *,
    pose_flange_point: Pose | None = None,
    speed_m_s: float = 0.25,
    acceleration_m_s2: float = 2.0,
    spacing_m: float = 0.005,
    spacing_rad: float = 0.025,
) -> JointTrajectory:
    """From rest along a straight line in space to rest, a point of the tool ending at a pose in the base frame.

    The point (default: the flange) moves on the line and turns about a fixed axis, with quintic timing; joint knots
    are at most about `spacing_m` and `spacing_rad` apart and carry the exact joint velocity and acceleration, so the
    deviation between knots is far below the spacing. The duration holds the point's peak speed and acceleration
    and every joint limit. Raises `crosspih_common.arm.inverse.InverseError` where the line cannot be followed.
    """
    offset = Pose.identity() if pose_flange_point is None else pose_flange_point
    start = JointSample.at_rest(start_rad)
    start_base_point = arm.pose_base_flange(start.position_rad) @ offset
    length_m = start_base_point.distance_to_m(goal_base_point)
    turn_rad = start_base_point.angle_to_rad(goal_base_point)
    pieces = int(np.clip(np.ceil(max(length_m / spacing_m, turn_rad / spacing_rad)), 8, 2000))
    times = np.linspace(0.0, 1.0, pieces + 1)
    fractions = times**3 * (10.0 - 15.0 * times + 6.0 * times**2)
    back = offset.inverse()
    flange_poses = [pose @ back for pose in straight_poses(start_base_point, goal_base_point, fractions)]
    joints = track(arm, flange_poses, start.position_rad)

    travel = goal_base_point.translation_m - start_base_point.translation_m
    turn = Rotation.from_matrix(start_base_point.rotation.T @ goal_base_point.rotation).as_rotvec()
    twist = np.concatenate([travel, start_base_point.rotation @ turn])  # of the point, a unit of path fraction
    fraction_speed = 30.0 * times**2 * (1.0 - times) ** 2
    fraction_acceleration = 60.0 * times * (1.0 - times) * (1.0 - 2.0 * times)
    try:
        velocities, accelerations = _line_rates(arm, joints, offset, twist, fraction_speed, fraction_acceleration)
    except np.linalg.LinAlgError as error:
        raise TrajectoryError("the line passes through a singularity of the arm") from error
    unit = JointTrajectory(times, joints, velocities, accelerations)

    peak_speed, peak_acceleration = unit.peaks()
    duration = max(
        _SHORTEST_S,
        REST_PEAK_SPEED * length_m / speed_m_s,
        float(np.sqrt(REST_PEAK_ACCELERATION * length_m / acceleration_m_s2)),
        float(np.max(peak_speed / limits.speed_rad_s)),
        float(np.max(np.sqrt(peak_acceleration / limits.acceleration_rad_s2))),
    )
    if duration > _LONGEST_S:
        worst = int(np.argmax(peak_speed / limits.speed_rad_s))
        raise TrajectoryError(
            f"the line would take {duration:.0f} s (limit {_LONGEST_S:g} s): joint {worst + 1} races next to a "
            "singularity, or the line is too long for speed_m_s"
        )
    trajectory = unit.stretched(duration)
    lines = trajectory.violations(limits)
    if lines:
        raise TrajectoryError("the line leaves a limit between its knots: " + "; ".join(lines))
    return trajectory


def _line_rates(
    arm: ArmModel, joints: Array, offset: Pose, twist: Array, speed: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Joint velocities and accelerations (k, n) at knots of a line: q' = J^-1 twist, q'' = -J^-1 (dJ/ds) q'.

    A seventh joint: J^-1 is the pseudo-inverse, the least motion, as `track` follows it.
    """
    velocities, accelerations = np.empty_like(joints), np.empty_like(joints)
    step = 1e-5
    for index, position in enumerate(joints):
        jacobian = arm.jacobian(position, offset)
        slope = _least_motion(jacobian, twist)
        ahead = arm.jacobian(position + step * slope, offset)
        behind = arm.jacobian(position - step * slope, offset)
        if arm.joints == 6:
            curvature = -np.linalg.solve(jacobian, (ahead - behind) @ slope / (2.0 * step))
        else:
            curvature = (_least_motion(ahead, twist) - _least_motion(behind, twist)) / (2.0 * step)
        velocities[index] = slope * speed[index]
        accelerations[index] = slope * acceleration[index] + curvature * speed[index] ** 2
    return velocities, accelerations


def _least_motion(jacobian: Array, twist: Array) -> Array:
    """The joint rates (n,) of least norm that make a twist (6,). Raises LinAlgError at a singularity."""
    if jacobian.shape[1] == 6:
        return np.asarray(np.linalg.solve(jacobian, twist))
    return np.asarray(jacobian.T @ np.linalg.solve(jacobian @ jacobian.T, twist))


def joined(parts: list[JointTrajectory]) -> JointTrajectory:
    """One trajectory of several, each starting in the state in which the one before ends (checked to 1e-6)."""
    if not parts:
        raise ValueError("parts is empty, want at least one trajectory")
    times, positions = [parts[0].times_s], [parts[0].positions_rad]
    velocities, accelerations = [parts[0].velocities_rad_s], [parts[0].accelerations_rad_s2]
    end = parts[0].duration_s
    for index, (before, after) in enumerate(pairwise(parts)):
        last, first = before.knot(-1), after.knot(0)
        gap = max(
            float(np.max(np.abs(first.position_rad - last.position_rad))),
            float(np.max(np.abs(first.velocity_rad_s - last.velocity_rad_s))),
            float(np.max(np.abs(first.acceleration_rad_s2 - last.acceleration_rad_s2))),
        )
        if gap > 1e-6:
            raise TrajectoryError(f"part {index + 1} starts {gap:.2e} away from the state in which part {index} ends")
        times.append(after.times_s[1:] + end)
        positions.append(after.positions_rad[1:])
        velocities.append(after.velocities_rad_s[1:])
        accelerations.append(after.accelerations_rad_s2[1:])
        end += after.duration_s
    return JointTrajectory(*(np.concatenate(rows) for rows in (times, positions, velocities, accelerations)))


__all__ = [
    "JointSample",
    "JointTrajectory",
    "Quintic",
    "TrajectoryError",
    "connect",
    "joined",
    "move_joints",
    "move_line",
    "move_through",
    "rest_duration_s",
    "scaled_limits",
    "straight_poses",
]
