"""Which pictures of the board are missing: parts of the picture, tilts, distances."""

from __future__ import annotations

import numpy as np

from crosspih_common.config.board import BoardPattern
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.calibration.pairs import Pair

ROWS, COLUMNS = ("upper", "middle", "lower"), ("left", "middle", "right")
MIN_IN_PART, MIN_PAIRS = 4, 8
TILT_RAD = np.deg2rad(15.0)
MIN_DISTANCES = 1.3
SIDES = ("left", "right")


def parts_seen(pairs: list[Pair], sizes: tuple[tuple[int, int], tuple[int, int]]) -> list[list[list[int]]]:
    """(3 x 3) counts for each camera, [camera][row][column]: the corners seen in each part of its picture."""
    counts = np.zeros((2, 3, 3), dtype=int)
    for pair in pairs:
        for side, (corners, (width, height)) in enumerate(zip(pair, sizes, strict=True)):
            if len(corners):
                part = np.clip(np.floor(3.0 * corners.pixels / [width, height]).astype(int), 0, 2)
                np.add.at(counts[side], (part[:, 1], part[:, 0]), 1)
    return [[[int(count) for count in row] for row in camera] for camera in counts]


def missing_parts(counts: list[list[list[int]]]) -> list[str]:
    """Advice on what to show next, by the parts of the pictures."""
    said = []
    for side, name in enumerate(SIDES):
        empty = [
            "middle" if row == column == 1 else f"{ROWS[row]} {COLUMNS[column]}".replace("middle ", "")
            for row in range(3)
            for column in range(3)
            if counts[side][row][column] < MIN_IN_PART
        ]
        if empty:
            said.append(f"the {name} camera saw next to nothing in the part: {', '.join(empty)}; show the board there")
    return said


def missing_poses(poses_camera_board: list[Pose], pattern: BoardPattern) -> list[str]:
    """Advice on what to show next, by the tilts and distances of the board in front of the left camera."""
    said = []
    if len(poses_camera_board) < MIN_PAIRS:
        said.append(f"{len(poses_camera_board)} pairs show the board; take {MIN_PAIRS} or more")
    if not poses_camera_board:
        return said
    tilts = np.array([tilt(pose) for pose in poses_camera_board])
    ways = (
        (0, 1.0, "its right edge away from the camera"), (0, -1.0, "its left edge away from the camera"),
        (1, 1.0, "its lower edge away from the camera"), (1, -1.0, "its upper edge away from the camera"),
    )  # fmt: skip
    said += [
        f"no picture has the board tilted, {how}, by {np.rad2deg(TILT_RAD):.0f} degrees or more"
        for axis, sign, how in ways
        if not np.any(sign * tilts[:, axis] >= TILT_RAD)
    ]
    middle = np.append(pattern.size_m / 2.0, 0.0)
    away = np.array([np.linalg.norm(pose.apply(middle)) for pose in poses_camera_board])
    if float(away.max() / away.min()) < MIN_DISTANCES:
        said.append(
            f"all pictures are from {away.min() * 1e3:.0f} to {away.max() * 1e3:.0f} mm; show the board nearer or "
            f"farther as well, {MIN_DISTANCES:g} times"
        )
    return said


def tilt(pose_camera_board: Pose) -> Array:
    """(2,): how far the board's normal leans right and down in the camera's picture, rad; (0, 0): the board faces the
    camera.

    Positive: that edge is farther away.
    """
    x, y, z = pose_camera_board.rotation[:, 2]
    return np.array([-np.arctan2(x, z), -np.arctan2(y, z)])
