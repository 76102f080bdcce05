"""The region that the plate with the hole may occupy by the cell's prior, and the working zone of the peg before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole

WORKING_TILT_RAD = 0.5  # between the peg's axis and the nominal hole's; more is no assembly
BELIEVED = 2.0  # times the half ranges: how far from nominal an estimate of the hole may be


@dataclass(frozen=True, slots=True, eq=False)
class Fixture:
    """The fixture's zone, in the nominal hole's frame; metres.

    `lower_m` and `upper_m` (3,) are the box that covers the plate at every pose the prior allows. The peg is at work
    where its tip is within `working_radius_m` of the nominal axis and not behind the box, and its axis within
    `WORKING_TILT_RAD` of the nominal one. `stand_radius_m` is that of an upright column under the plate, the
    prior's range included; None where there is none. `half_ranges` (6,) are the prior's, m and rad.
    """

    pose_base_hole: Pose
    lower_m: Array
    upper_m: Array
    working_radius_m: float
    plate_lower_m: Array
    plate_upper_m: Array
    stand_radius_m: float | None
    half_ranges: Array

    @classmethod
    def of(cls, workcell: Workcell) -> Fixture:
        """The fixture of a cell: from the hole's drawing and the hole's prior."""
        hole = workcell.hole.shape(workcell.peg.shape())
        ranges = workcell.hole_prior.half_ranges()
        lower, upper = plate_corners_m(hole)
        grown = ranges[:3] + turned_by_m(lower, upper, ranges[3:])
        tilt = float(np.linalg.norm(ranges[3:5]))
        radius = hole.opening().reach_m + BELIEVED * float(
            np.max(ranges[:2]) + tilt * (grown[2] + workcell.surroundings.margin_m)
        )
        stand = workcell.surroundings.stand_radius_m
        pose = workcell.hole_prior.pose_base_hole()
        opens_down = float(pose.rotation[:, 2] @ upwards(workcell)) > np.cos(np.pi / 4)
        if stand is not None:
            stand += float(np.linalg.norm(ranges[:3] + turned_by_m(centre := (lower + upper) / 2, centre, ranges[3:])))
        return cls(pose, lower - grown, upper + grown, radius, lower, upper, None if opens_down else stand, ranges)

    def at_work(self, pose_base_peg: Pose, tip_m: float) -> bool:
        """Whether a peg with its tip at (0, 0, `tip_m`), m, in the peg frame is in the working zone."""
        pose_hole_peg = self.pose_base_hole.inverse() @ pose_base_peg
        x, y, z = pose_hole_peg.apply([0.0, 0.0, tip_m])
        aligned = pose_hole_peg.rotation[2, 2] > np.cos(WORKING_TILT_RAD)
        return bool(aligned and np.hypot(x, y) <= self.working_radius_m and z <= self.upper_m[2])

    def distances_m(self, points_base_m: Array) -> Array:
        """Distances (...) of points (..., 3), base frame, m, from the plate's region; 0 in it and behind its front.

        Finer than the box: by the plate's possible tilt, its front is nearer to the arm farther from the axis.
        """
        lateral, depth, turn = self.half_ranges[0], self.half_ranges[2], self.half_ranges[3]
        half = self.plate_upper_m[0] * (1.0 + turn) + lateral
        x, y, z = np.moveaxis(self.pose_base_hole.inverse().apply(points_base_m), -1, 0)
        across = np.maximum(np.maximum(np.abs(x), np.abs(y)) - half, 0.0)
        lean = turn * np.minimum(np.abs(x) + np.abs(y), 2.0 * half)
        before = np.maximum(-z - depth - lean, 0.0)
        return np.asarray(np.hypot(across, before))

    def before_m(self, points_base_m: Array) -> float:
        """Distances of points (k, 3) in front of the plane of the box's front; negative behind it."""
        return float(self.lower_m[2] - np.max(self.pose_base_hole.inverse().apply(points_base_m)[:, 2]))


def upwards(workcell: Workcell) -> Array:
    """The unit vector (3,) against gravity, base frame."""
    gravity = np.asarray(workcell.gravity_base_m_s2)
    return np.asarray(-gravity / np.linalg.norm(gravity), dtype=float)


def plate_corners_m(hole: Hole) -> tuple[Array, Array]:
    """The lower and the upper corner (3,) of the plate in the hole frame."""
    half = hole.plate_half_size_m
    return np.array([-half, -half, 0.0]), np.array([half, half, hole.depth_m])


def turned_by_m(lower_m: Array, upper_m: Array, half_ranges_rad: Array) -> Array:
    """An upper bound (3,), m, of how far a rotation about the frame's origin moves any point of a box along each axis.

    Each component of the rotation vector is within its half range (3,): w x p and the rest of Rodrigues' formula.
    """
    reach = np.maximum(np.abs(lower_m), np.abs(upper_m))
    turn = np.asarray(half_ranges_rad, float)
    first = np.array(
        [turn[(i + 1) % 3] * reach[(i + 2) % 3] + turn[(i + 2) % 3] * reach[(i + 1) % 3] for i in range(3)]
    )
    angle = float(np.linalg.norm(turn))
    rest = 0.5 * angle**2 * np.sqrt(1.0 + angle**2 / 9.0) * float(np.linalg.norm(reach))
    return np.asarray(first + rest, dtype=float)
