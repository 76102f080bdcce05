"""The moving parts: the arm's links as capsules, the tool as a cylinder, the peg as its convex hull."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

TOOL, PEG = "the tool", "the peg"


@dataclass(frozen=True, slots=True, eq=False)
class MovingPart:
    """A part fixed to one of the arm's frames; lengths in m.

    `frame` indexes `ArmModel.link_poses`, `pose_frame_part` is the part's centre in it. `radius_m` and `length_m` are a
    capsule's (`round_ends`, the length without its ends) or a cylinder's about the part's z; `corners_m` (k, 3) those
    of a convex hull in the part's frame, which has neither. `bound_m` is the radius of a ball about the centre that
    holds the part.
    """

    name: str
    frame: int
    pose_frame_part: Pose
    bound_m: float
    radius_m: float = 0.0
    length_m: float = 0.0
    round_ends: bool = False
    corners_m: Array | None = None


def moving_parts(workcell: Workcell) -> list[MovingPart]:
    """The links 1 to n, the tool and the peg, in this order."""
    arm = workcell.arm()
    last = arm.joints
    parts = []
    for index, (line, radius) in enumerate(zip(arm.link_lines_m, arm.link_radii_m, strict=True)):
        pose, length = along(line[0], line[1])
        bound = length / 2 + float(radius)
        parts.append(MovingPart(f"arm link {index + 1}", index + 1, pose, bound, float(radius), length, True))
    peg = workcell.peg.shape()
    pose_flange_peg = workcell.pose_flange_peg()
    body_m = max(peg.body_start_m, 1e-3)
    pose, length = along(np.zeros(3), pose_flange_peg.apply([0.0, 0.0, body_m]))
    tool_m = workcell.surroundings.tool_radius_m
    parts.append(MovingPart(TOOL, last, pose, float(np.hypot(length / 2, tool_m)), tool_m, length))
    corners = np.vstack([piece.vertices_m() for piece in peg.pieces()])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    corners = corners - middle
    bound = float(np.linalg.norm(corners, axis=1).max())
    pose = pose_flange_peg @ Pose.from_translation(middle)
    parts.append(MovingPart(PEG, last, pose, bound, corners_m=corners))
    return parts


def along(start_m: Array, end_m: Array) -> tuple[Pose, float]:
    """A frame in the middle of two points (3,), its z from the first to the second, and their distance."""
    way = np.asarray(end_m, float) - start_m
    length = float(np.linalg.norm(way))
    if length < 1e-9:
        return Pose.from_translation(np.asarray(start_m, float)), 0.0
    axis = way / length
    aside = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    aside /= np.linalg.norm(aside)
    rotation = np.column_stack([aside, np.cross(axis, aside), axis])
    return Pose(rotation, start_m + way / 2), length


def reaches_m(workcell: Workcell, parts: list[MovingPart]) -> Array:
    """Upper bounds (n,), m, of the distance of any point of the parts from each joint's axis, in any posture."""
    arm = workcell.arm()
    count = arm.joints
    _, places = arm.frames(np.zeros(count))
    reaches = np.zeros(count)
    for joint in range(count):
        for part in parts:
            if part.frame > joint:
                way = sum(float(np.linalg.norm(places[k + 1] - places[k])) for k in range(joint, part.frame))
                own = float(np.linalg.norm(part.pose_frame_part.translation_m)) + part.bound_m
                reaches[joint] = max(reaches[joint], way + own)
    return reaches
