"""Postures in which the arm shows the board to both cameras, and collision-free ways between them.

The poses of the cameras and of the board need to be known only roughly: a margin is kept to the pictures' edges. The
collision model is the planner's; the hardware checks each way again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.arm.inverse import InverseError, solver
from crosspih_common.calibration.fitting import CalibrationRefused
from crosspih_common.collision import CollisionModel
from crosspih_common.config import Workcell
from crosspih_common.config.board import BoardPattern
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, CameraModel

SHARES = (0.24, 0.62)  # share of the picture's width that the board covers
TILT_RAD, SPIN_RAD = 0.65, np.pi
EDGE_PX = 10.0
TRIES, WANTED, NEIGHBOURS, SPARE_M = 3000, 70, 8, 0.002
VIA = 60
# weight of a difference in each: place in the picture, distance, tilts, spin
WEIGHTS = np.array([2.0, 2.0, 1.5, 1.6, 1.6, 0.5])


@dataclass(frozen=True, slots=True, eq=False)
class ShownPosture:
    """A posture (n,), rad, and how the board is seen there: place in the picture, distance, tilts and spin, (6,)."""

    joints_rad: Array
    seen: Array


def _pixels(points_m: Array, model: CameraModel) -> Array:
    return np.stack(
        [
            model.fx_px * points_m[:, 0] / points_m[:, 2] + model.cx_px,
            model.fy_px * points_m[:, 1] / points_m[:, 2] + model.cy_px,
        ],
        axis=1,
    )


def _in_both(outline_m: Array, cameras: CameraCalibration) -> bool:
    back = cameras.pose_left_right.pose().inverse()
    for points, model in ((outline_m, cameras.left), (back.apply(outline_m), cameras.right)):
        if float(points[:, 2].min()) < 0.02:
            return False
        pixels = _pixels(points, model)
        if np.any(pixels < EDGE_PX) or np.any(pixels > np.array([model.width_px, model.height_px]) - EDGE_PX):
            return False
    return True


def outline_px(
    workcell: Workcell, cameras: CameraCalibration, pattern: BoardPattern, pose_flange_board: Pose, joints_rad: Array
) -> list[list[list[float]]]:
    """The board's outline in the left and the right picture in a posture (n,): two lists of pixels, approximate because
    lens distortion is ignored.
    """
    base = workcell.arm().pose_base_flange(joints_rad)
    outline = (cameras.pose_base_camera.pose().inverse() @ base @ pose_flange_board).apply(pattern.outline_m())
    beside = cameras.pose_left_right.pose().inverse().apply(outline)
    return [_pixels(outline, cameras.left).tolist(), _pixels(beside, cameras.right).tolist()]


def drawn_before(
    cameras: CameraCalibration, pattern: BoardPattern, rng: np.random.Generator
) -> tuple[Pose, Array] | None:
    """`pose_camera_board` anywhere in the picture, with how the board is seen there; None where a picture does not show
    all of it.
    """
    width_m, height_m = pattern.size_m
    middle, left = np.array([width_m / 2, height_m / 2, 0.0]), cameras.left
    share = float(np.exp(rng.uniform(*np.log(SHARES))))
    away = width_m * left.fx_px / (share * left.width_px)
    place = rng.uniform(0.1, 0.9, 2)
    at = place * [left.width_px, left.height_px] - [left.cx_px, left.cy_px]
    centre = np.array([at[0] / left.fx_px, at[1] / left.fy_px, 1.0]) * away
    tilts, spin = rng.uniform(-TILT_RAD, TILT_RAD, 2), rng.uniform(-SPIN_RAD, SPIN_RAD)
    turn = Rotation.from_rotvec([*tilts, 0.0]) * Rotation.from_rotvec([0.0, 0.0, spin])
    board = Pose(turn.as_matrix(), centre - turn.apply(middle))
    if not _in_both(board.apply(pattern.outline_m()), cameras):
        return None
    return board, np.array([*place, np.log(away), *tilts, spin])


def candidates(
    workcell: Workcell, cameras: CameraCalibration, pattern: BoardPattern, pose_flange_board: Pose,
    collisions: CollisionModel, rng: np.random.Generator,
) -> list[ShownPosture]:  # fmt: skip
    """Postures clear of everything, sampled over the picture, distances, tilts and spins."""
    arm, home = workcell.arm(), np.asarray(workcell.home_joints_rad, float)
    to_flange, pose_base_camera = pose_flange_board.inverse(), cameras.pose_base_camera.pose()
    found: list[ShownPosture] = []
    for _ in range(TRIES):
        if len(found) >= WANTED:
            break
        drawn = drawn_before(cameras, pattern, rng)
        if drawn is None:
            continue
        try:
            # from home only: an arm without a closed form searches long for poses that it cannot reach
            joints = solver(arm).follow(pose_base_camera @ drawn[0] @ to_flange, home)
        except InverseError:
            continue
        if collisions.clearance(joints).distance_m < collisions.margin_m + SPARE_M:
            continue
        found.append(ShownPosture(joints, drawn[1]))
    return found


def reached(
    home: Array, shown: list[ShownPosture], vias: list[Array], collisions: CollisionModel
) -> tuple[list[Array], list[int], list[int]]:
    """Nodes that can be reached from home, the parent of each (-1: home itself), and the index in `shown` of each (-1:
    a node on the way).
    """
    nodes, parents, which = [home], [-1], [-1]
    left = [(one.joints_rad, index) for index, one in enumerate(shown)] + [(joints, -1) for joints in vias]
    grown = True
    while grown and left:
        grown, rest = False, []
        for joints, index in left:
            order = np.argsort([float(np.max(np.abs(node - joints))) for node in nodes])[:NEIGHBOURS]
            for parent in order.tolist():
                if collisions.check_path([nodes[parent], joints]) is None:
                    nodes.append(joints)
                    parents.append(parent)
                    which.append(index)
                    grown = True
                    break
            else:
                rest.append((joints, index))
        left = rest
    return nodes, parents, which


def spread_out(shown: list[ShownPosture], count: int) -> list[int]:
    """The most different postures, by farthest-point selection."""
    seen = np.array([one.seen for one in shown]) * WEIGHTS / np.array([1.0, 1.0, 0.5, TILT_RAD, TILT_RAD, SPIN_RAD])
    chosen = [int(np.argmin(np.linalg.norm(seen - seen.mean(axis=0), axis=1)))]
    while len(chosen) < min(count, len(shown)):
        nearest_m = np.linalg.norm(seen[:, None] - seen[chosen], axis=2).min(axis=1)
        chosen.append(int(np.argmax(nearest_m)))
    return chosen


def tour(
    workcell: Workcell, cameras: CameraCalibration, pattern: BoardPattern, pose_flange_board: Pose, start: Array,
    count: int, seed: int = 0,
) -> list[list[Array]]:  # fmt: skip
    """Ways, one per picture: joint knots (n,) from the arm's current posture to the next one; the last way leads home.

    Raises CalibrationRefused where too few postures show the board, and says what to move.
    """
    collisions, rng = CollisionModel(workcell), np.random.default_rng(seed)
    shown = candidates(workcell, cameras, pattern, pose_flange_board, collisions, rng)
    arm = workcell.arm()
    span = np.array([0.9] * (arm.joints - 3) + [1.6] * 3)
    low, high = np.maximum(arm.limits.lower_rad, start - span), np.minimum(arm.limits.upper_rad, start + span)
    drawn = [low + rng.random(arm.joints) * (high - low) for _ in range(VIA)]
    wide = collisions.margin_m + SPARE_M
    vias = [joints for joints in drawn if collisions.clearance(joints).distance_m >= wide]
    nodes, parents, which = reached(start, shown, vias, collisions)
    reachable = [index for index in which if index >= 0]
    if len(reachable) < min(count, 6):
        raise CalibrationRefused(
            f"{len(shown)} postures show the board to both cameras and {len(reachable)} of them can be driven to, want "
            f"{count}: mount the board elsewhere on the flange (operator.board.pose_flange_board), take a smaller one, "
            "or start from another posture"
        )
    chosen = spread_out([shown[index] for index in reachable], count)
    goals = [nodes[which.index(reachable[index])] for index in chosen]
    numbers = [which.index(reachable[index]) for index in chosen]
    ways, here, left = [], 0, list(zip(numbers, goals, strict=True))
    while left:
        left.sort(key=lambda goal: float(np.max(np.abs(goal[1] - nodes[here]))))
        number, _ = left.pop(0)
        ways.append(_way(nodes, parents, here, number, collisions))
        here = number
    ways.append(_way(nodes, parents, here, 0, collisions))
    return ways


def _way(nodes: list[Array], parents: list[int], start: int, goal: int, collisions: CollisionModel) -> list[Array]:
    if collisions.check_path([nodes[start], nodes[goal]]) is None:
        return [nodes[start], nodes[goal]]
    up, down = [start], [goal]
    while parents[up[-1]] >= 0:
        up.append(parents[up[-1]])
    while parents[down[-1]] >= 0:
        down.append(parents[down[-1]])
    while len(up) > 1 and len(down) > 1 and up[-2] == down[-2]:
        up.pop()
        down.pop()
    return [nodes[index] for index in [*up, *reversed(down[:-1])]]
