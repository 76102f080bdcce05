"""The cell's bodies as meshes: the arm by its capsules, tool and peg, and the plate with the hole, cut open if wanted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.operator.scene3d.meshes import Colour, Mesh, capsule, convex, cylinder, flat, joined

LINK: Colour = (0.86, 0.87, 0.89)
JOINT: Colour = (0.30, 0.34, 0.40)
TOOL: Colour = (0.42, 0.45, 0.50)
PEG: Colour = (0.95, 0.62, 0.18)
PLATE: Colour = (0.58, 0.65, 0.74)
CUT: Colour = (0.78, 0.36, 0.30)
FLOOR: Colour = (0.80, 0.82, 0.85)
SHADOW: Colour = (0.66, 0.68, 0.72)
THINNER = 0.8  # of the capsules for collisions, which hold the link with room to spare
PLATE_HALF_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """Meshes that do not change, each in its own frame: the peg in the peg frame, the plate in the hole frame."""

    workcell: Workcell
    peg: Mesh
    plate: Mesh
    plate_cut: Mesh

    @classmethod
    def of(cls, workcell: Workcell) -> Bodies:
        """From the drawings."""
        peg = workcell.peg.shape()
        solid = [convex(piece.vertices_m(), PEG) for piece in peg.pieces()]
        blocks = [piece.vertices_m() for piece in workcell.hole.shape(peg).pieces()]
        plate = [convex(corners, PLATE) for corners in blocks]
        # half of the plate is taken away: what has x > 0 in the hole's frame
        cut = [convex(corners, PLATE, (np.array([1.0, 0.0, 0.0]), 0.0, CUT)) for corners in blocks]
        return cls(workcell, *(joined([mesh for mesh in each if mesh is not None]) for each in (solid, plate, cut)))

    def arm(self, joints_rad: Array | tuple[float, ...]) -> Mesh:
        """The arm and its tool at joint angles (n,), base frame; without the peg."""
        arm = self.workcell.arm()
        poses = arm.link_poses(joints_rad)
        parts = []
        for index, (line, radius) in enumerate(zip(arm.link_lines_m, arm.link_radii_m, strict=True)):
            start, end = poses[index + 1].apply(line)
            parts.append(capsule(start, end, THINNER * float(radius), LINK))
            axis = poses[index].rotation[:, 2]
            origin = poses[index].translation_m
            half = 1.05 * THINNER * float(radius)
            parts.append(cylinder(origin - half * axis, origin + half * axis, 1.05 * THINNER * float(radius), JOINT))
        flange = poses[-1]
        tool_m = self.workcell.surroundings.tool_radius_m
        end = (flange @ self.workcell.pose_flange_peg()).apply([0.0, 0.0, self.workcell.peg.shape().body_start_m])
        if float(np.linalg.norm(end - flange.translation_m)) > 1e-6:
            parts.append(cylinder(flange.translation_m, end, 0.8 * tool_m, TOOL))
        return joined(parts)

    def floor(self, half_m: float = 0.9) -> Mesh:
        """The ground at the height of the base."""
        corners = np.array([[-half_m, -half_m, 0], [half_m, -half_m, 0], [half_m, half_m, 0], [-half_m, half_m, 0]])
        return flat(np.array([corners[[0, 1, 2]], corners[[0, 2, 3]]], float), FLOOR)


def shadow(mesh: Mesh, light: Array) -> Mesh:
    """What a mesh darkens on the ground, a little above it, under light from `light` (3,)."""
    light = np.asarray(light, float)
    points = mesh.corners_m - mesh.corners_m[..., 2:] / light[2] * light
    points[..., 2] = 0.0008
    return Mesh(points, np.broadcast_to([0.0, 0.0, 1.0], points.shape), np.tile(SHADOW, (len(points), 1)))


def where_peg_is(workcell: Workcell, joints_rad: Array | tuple[float, ...], wrench: Array | None = None) -> Pose:
    """`pose_base_peg` by the encoders, and with a wrench (6,) on the peg, peg frame, as the arm gives way to it."""
    pose = workcell.pose_base_peg(joints_rad)
    if wrench is None:
        return pose
    twist = workcell.arm_compliance_peg(joints_rad) @ np.asarray(wrench)
    return pose @ Pose.from_rotvec(twist[3:], twist[:3])
