"""Poses for the six-pose calibration: gravity in well-spread directions of the sensor, tool clear of everything.

Candidates around a given arm posture are drawn from a Halton sequence (deterministic), those near to the cell's
surroundings or to the arm itself are dropped, and a D-optimal set is picked greedily for the two linear problems of
Eqs. 14-16 (weight vector and force bias; centroid and moment bias). The poses are then put in the order of least motion
in which each straight joint path to the next keeps the cell's margin too.

Errors: `CalibrationPosesError` (ValueError), no such set exists around this posture.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise, permutations

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.arm.kinematics import ArmModel
from crosspih_common.collision import CollisionModel
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import skew

SPARE_M = 0.02  # extra distance of poses beyond the margin, so that paths to them are easier to find
_ROUGH_CENTROID_M = np.array([0.0, 0.0, 0.03])


class CalibrationPosesError(ValueError):
    """No set of calibration poses exists around this posture."""


def choose_calibration_poses(
    arm: ArmModel,
    around_joints_rad: ArrayLike,
    collisions: CollisionModel,
    *,
    count: int = 6,
    candidates: int = 500,
) -> list[Array]:
    """Joint vectors (`count` of (n,), rad) for calibration, in the order to visit, starting from a posture.

    All lie inside the limits; they, and the straight joint paths from the start through all of them, keep the
    margin of `collisions`. The joints before the last three stay within 0.6 rad of the start. Raises
    `CalibrationPosesError` naming what is in the way.
    """
    start = np.asarray(around_joints_rad, dtype=float)
    lines = arm.limits.violations(start)
    if lines:
        raise CalibrationPosesError("around_joints_rad: " + "; ".join(lines))
    found = collisions.clearance(start)
    if found.distance_m < collisions.margin_m:
        raise CalibrationPosesError(
            f"around_joints_rad leaves {found.distance_m * 1e3:.0f} mm between {found.moving} and {found.obstacle}, "
            f"want {collisions.margin_m * 1e3:.0f} mm: start from a posture farther away"
        )
    if count < 6:
        raise CalibrationPosesError(f"count wants at least 6 poses, got {count}")

    clear, in_the_way = _clear_candidates(arm, start, collisions, candidates)
    information = [_information(arm.pose_base_flange(joints).rotation) for joints in clear]
    reachable: dict[int, bool] = {}
    banned: set[int] = set()
    for _ in range(20):
        chosen = _d_optimal(start, clear, information, collisions, count, reachable, banned, in_the_way)
        order = _clear_order(arm, start, [clear[index] for index in chosen], collisions)
        if order is not None:
            return [clear[chosen[position]] for position in order]
        banned.add(chosen[-1])
    raise CalibrationPosesError(f"no order of the poses has clear paths between them: start farther from {in_the_way}")


def _clear_candidates(arm: ArmModel, start: Array, collisions: CollisionModel, count: int) -> tuple[list[Array], str]:
    """The collision-free candidates, and the obstacle that most of the others are too near to."""
    margin = np.deg2rad(2.0)
    # the joints before the wrist stay about where they are, the last turns half way round at most
    range_rad = np.array([*[0.6] * (arm.joints - 3), 9.0, 9.0, np.pi])
    low = np.maximum(arm.limits.lower_rad + margin, start - range_rad)
    high = np.minimum(arm.limits.upper_rad - margin, start + range_rad)
    from scipy.stats import qmc  # half a second to load, and only a calibration wants it

    unit = qmc.Halton(arm.joints, scramble=False).random(count + 1)[1:]
    vectors = low + unit * (np.maximum(high, low) - low)
    found = [collisions.clearance(joints) for joints in vectors]
    clear = [one.distance_m >= collisions.margin_m + SPARE_M for one in found]
    blocked = Counter(one.obstacle for one, free in zip(found, clear, strict=True) if not free)
    most = blocked.most_common(1)
    return [joints for joints, free in zip(vectors, clear, strict=True) if free], most[0][
        0
    ] if most else "what is around"


def _information(rotation: Array) -> tuple[Array, Array]:
    """The information of one pose on (weight vector, force bias) and (centroid, moment bias), each (6, 6), scaled."""
    force = rotation.T @ np.array([0.0, 0.0, -1.0])
    rows = np.hstack([rotation.T, np.eye(3)])
    levers = np.hstack([-skew(force), np.eye(3)])
    return rows.T @ rows, levers.T @ levers


def _d_optimal(
    start: Array,
    clear: list[Array],
    information: list[tuple[Array, Array]],
    collisions: CollisionModel,
    count: int,
    reachable: dict[int, bool],
    banned: set[int],
    in_the_way: str,
) -> list[int]:
    chosen: list[int] = []
    total = (1e-3 * np.eye(6), 1e-3 * np.eye(6))
    for _ in range(count):
        gains = np.array(
            [
                np.linalg.slogdet(total[0] + force)[1]
                + np.linalg.slogdet(total[1] + moment)[1]
                # A small penalty on motion: it costs 0.1 of condition number and saves a quarter of the travel.
                - 0.1 * float(np.max(np.abs(joints - start)))
                for (force, moment), joints in zip(information, clear, strict=True)
            ]
        )
        for index in np.argsort(-gains, kind="stable").tolist():
            if index in banned or index in chosen:
                continue
            if index not in reachable:
                reachable[index] = collisions.check_path([start, clear[index]]) is None
            if reachable[index]:
                chosen.append(index)
                total = (total[0] + information[index][0], total[1] + information[index][1])
                break
        else:
            raise CalibrationPosesError(
                f"only {len(chosen)} of {count} poses can be reached clear of everything: "
                f"start farther from {in_the_way}"
            )
    return chosen


def _clear_order(arm: ArmModel, start: Array, poses: list[Array], collisions: CollisionModel) -> tuple[int, ...] | None:
    """The order of least travel whose paths are all clear; None when there is none."""
    speed = arm.limits.speed_rad_s
    nodes = [*poses, start]
    home = len(poses)
    clear = {
        (a, b): collisions.check_path([nodes[a], nodes[b]]) is None for a in range(home) for b in range(a + 1, home)
    }
    travel = np.array([[float(np.max(np.abs(a - b) / speed)) for b in nodes] for a in nodes])
    best, best_travel = None, float("inf")
    for order in permutations(range(home)) if home <= 7 else [_greedy_order(travel, home)]:
        length = float(travel[home, order[0]]) + sum(float(travel[a, b]) for a, b in pairwise(order))
        if length < best_travel and all(clear[min(a, b), max(a, b)] for a, b in pairwise(order)):
            best, best_travel = order, length
    return best


def _greedy_order(travel: Array, home: int) -> tuple[int, ...]:
    left, at, order = set(range(home)), home, []
    while left:
        at = min(left, key=lambda node, at=at: (travel[at, node], node))  # type: ignore[misc]
        left.remove(at)
        order.append(at)
    return tuple(order)
