"""Poses for the six-pose calibration: gravity in well-spread directions of the sensor, tool clear of everything.

Candidates around a given arm posture are drawn from a Halton sequence (deterministic), those with the tool or forearm
near the floor, the fixture or the arm itself are dropped, and a D-optimal set is picked greedily for the two linear
problems of Eqs. 14-16 (weight vector and force bias; centroid and moment bias). The poses are then put in the order of
least motion in which each straight joint path to the next is clear too.

Errors: `CalibrationPosesError` (ValueError), no such set exists around this posture.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, permutations

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import qmc

from crosspih_common.arm.kinematics import ArmModel
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import skew

_ROUGH_CENTROID_M = np.array([0.0, 0.0, 0.03])


class CalibrationPosesError(ValueError):
    """No set of calibration poses exists around this posture."""


@dataclass(frozen=True, slots=True)
class KeepOutBox:
    """An axis-aligned box (base frame, m) that the tool and the forearm stay out of."""

    name: str
    lower_m: tuple[float, float, float]
    upper_m: tuple[float, float, float]

    def distance_m(self, points_m: Array) -> Array:
        """The distance (n,) of points (n, 3) from the box, 0 inside."""
        lower, upper = np.asarray(self.lower_m), np.asarray(self.upper_m)
        outside = np.maximum(np.maximum(lower - points_m, points_m - upper), 0.0)
        return np.asarray(np.linalg.norm(outside, axis=1), dtype=float)


FIXTURE = KeepOutBox("fixture", (0.36, -0.42, 0.08), (0.7, -0.18, 0.32))
"""The plate with the hole, wherever a trial draws it, with its stand."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What to stay clear of, and how thick the moving parts are; metres.

    `tool_length_m` is flange to peg tip; radii bound the tool, forearm, upper arm and base column around their axes.
    """

    boxes: tuple[KeepOutBox, ...] = (FIXTURE,)
    floor_z_m: float = 0.05
    margin_m: float = 0.015
    tool_length_m: float = 0.146
    tool_radius_m: float = 0.035
    forearm_radius_m: float = 0.06
    upper_arm_radius_m: float = 0.065
    column_radius_m: float = 0.1


def clearance_m(arm: ArmModel, joints_rad: ArrayLike, surroundings: Surroundings) -> tuple[float, str]:
    """The least free distance (m, negative inside) of tool and forearm at joints (n,), and from what.

    The tool is checked against boxes, floor, base column and upper arm; the forearm against boxes and floor. The
    tool cannot fold onto the forearm inside the limits of joint 5.
    """
    poses = arm.link_poses(joints_rad)
    # a seventh joint turns the upper arm
    marks = (1, 2, 4, 6) if arm.joints == 6 else (1, 3, 5, 7)
    shoulder, elbow, wrist, flange = (poses[index].translation_m for index in marks)
    tip = poses[-1].apply([0.0, 0.0, surroundings.tool_length_m])
    share = np.linspace(0.0, 1.0, 11)[:, None]
    tool, forearm = flange + share * (tip - flange), elbow + share * (wrist - elbow)
    distances = []
    for name, points, radius in (
        ("the tool", tool, surroundings.tool_radius_m),
        ("the forearm", forearm, surroundings.forearm_radius_m),
    ):
        for box in surroundings.boxes:
            distances.append((float(box.distance_m(points).min()) - radius, f"{name} and the {box.name}"))
        distances.append((float(points[:, 2].min()) - surroundings.floor_z_m - radius, f"{name} and the floor"))
    for name, start, end, radius in (
        ("the base column", np.zeros(3), np.array([0.0, 0.0, shoulder[2]]), surroundings.column_radius_m),
        ("the upper arm", shoulder, elbow, surroundings.upper_arm_radius_m),
    ):
        gap = float(_distance_to_segment(tool, start, end).min()) - radius - surroundings.tool_radius_m
        distances.append((gap, f"the tool and {name}"))
    return min(distances)


def _distance_to_segment(points: Array, start: Array, end: Array) -> Array:
    along = end - start
    share = np.clip((points - start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - (start + share[:, None] * along), axis=1), dtype=float)


def path_is_clear(
    arm: ArmModel, start_rad: ArrayLike, goal_rad: ArrayLike, surroundings: Surroundings, step_rad: float = 0.08
) -> bool:
    """Whether a straight joint path between two postures keeps the margin at every step."""
    start, goal = np.asarray(start_rad, dtype=float), np.asarray(goal_rad, dtype=float)
    count = max(2, int(np.ceil(np.max(np.abs(goal - start)) / step_rad)) + 1)
    return all(
        clearance_m(arm, start + share * (goal - start), surroundings)[0] >= surroundings.margin_m
        for share in np.linspace(0.0, 1.0, count)
    )


def choose_calibration_poses(
    arm: ArmModel,
    around_joints_rad: ArrayLike,
    *,
    count: int = 6,
    surroundings: Surroundings | None = None,
    candidates: int = 500,
) -> list[Array]:
    """Joint vectors (`count` of (n,), rad) for calibration, in the order to visit, starting from a posture.

    All lie inside the limits; they, and the straight joint paths from the start through all of them, keep the
    margin. The joints before the last three stay within 0.6 rad of the start. Raises `CalibrationPosesError` naming
    what is in the way.
    """
    surroundings = Surroundings() if surroundings is None else surroundings
    start = np.asarray(around_joints_rad, dtype=float)
    lines = arm.limits.violations(start)
    if lines:
        raise CalibrationPosesError("around_joints_rad: " + "; ".join(lines))
    gap, what = clearance_m(arm, start, surroundings)
    if gap < surroundings.margin_m:
        raise CalibrationPosesError(
            f"around_joints_rad leaves {gap * 1e3:.0f} mm between {what}, want {surroundings.margin_m * 1e3:.0f} mm: "
            "start from a posture farther away"
        )
    if count < 6:
        raise CalibrationPosesError(f"count wants at least 6 poses, got {count}")

    clear = _clear_candidates(arm, start, surroundings, candidates)
    information = [_information(arm.pose_base_flange(joints).rotation) for joints in clear]
    reachable: dict[int, bool] = {}
    banned: set[int] = set()
    for _ in range(20):
        chosen = _d_optimal(arm, start, clear, information, surroundings, count, reachable, banned)
        order = _clear_order(arm, start, [clear[index] for index in chosen], surroundings)
        if order is not None:
            return [clear[chosen[position]] for position in order]
        banned.add(chosen[-1])
    raise CalibrationPosesError("no order of the poses has clear paths between them: start farther from the fixture")


def _clear_candidates(arm: ArmModel, start: Array, surroundings: Surroundings, count: int) -> list[Array]:
    margin = np.deg2rad(2.0)
    # the joints before the wrist stay about where they are, the last turns half way round at most
    range_rad = np.array([*[0.6] * (arm.joints - 3), 9.0, 9.0, np.pi])
    low = np.maximum(arm.limits.lower_rad + margin, start - range_rad)
    high = np.minimum(arm.limits.upper_rad - margin, start + range_rad)
    unit = qmc.Halton(arm.joints, scramble=False).random(count + 1)[1:]
    vectors = low + unit * (np.maximum(high, low) - low)
    return [joints for joints in vectors if clearance_m(arm, joints, surroundings)[0] >= surroundings.margin_m]


def _information(rotation: Array) -> tuple[Array, Array]:
    """What one pose tells of (weight vector, force bias) and of (centroid, moment bias), each (6, 6), scaled."""
    force = rotation.T @ np.array([0.0, 0.0, -1.0])
    rows = np.hstack([rotation.T, np.eye(3)])
    levers = np.hstack([-skew(force), np.eye(3)])
    return rows.T @ rows, levers.T @ levers


def _d_optimal(
    arm: ArmModel,
    start: Array,
    clear: list[Array],
    information: list[tuple[Array, Array]],
    surroundings: Surroundings,
    count: int,
    reachable: dict[int, bool],
    banned: set[int],
) -> list[int]:
    chosen: list[int] = []
    total = (1e-3 * np.eye(6), 1e-3 * np.eye(6))
    for _ in range(count):
        gains = np.array(
            [
                np.linalg.slogdet(total[0] + force)[1]
                + np.linalg.slogdet(total[1] + moment)[1]
                # A little against needless motion: it costs 0.1 of condition number and saves a quarter of the way.
                - 0.1 * float(np.max(np.abs(joints - start)))
                for (force, moment), joints in zip(information, clear, strict=True)
            ]
        )
        for index in np.argsort(-gains, kind="stable").tolist():
            if index in banned or index in chosen:
                continue
            if index not in reachable:
                reachable[index] = path_is_clear(arm, start, clear[index], surroundings)
            if reachable[index]:
                chosen.append(index)
                total = (total[0] + information[index][0], total[1] + information[index][1])
                break
        else:
            raise CalibrationPosesError(
                f"only {len(chosen)} of {count} poses can be reached clear of everything: "
                "start farther from the fixture"
            )
    return chosen


def _clear_order(arm: ArmModel, start: Array, poses: list[Array], surroundings: Surroundings) -> tuple[int, ...] | None:
    """The order of least travel whose paths are all clear; None when there is none."""
    speed = arm.limits.speed_rad_s
    nodes = [*poses, start]
    home = len(poses)
    clear = {
        (a, b): path_is_clear(arm, nodes[a], nodes[b], surroundings) for a in range(home) for b in range(a + 1, home)
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
