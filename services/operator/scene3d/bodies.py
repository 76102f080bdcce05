"""The cell's bodies as meshes: the arm from its capsules, tool and peg, and the plate with the hole, also cut open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.operator.scene3d.meshes import Colour, DrawnMesh, capsule, convex, cylinder, joined

LINK: Colour = (0.86, 0.87, 0.89)
JOINT: Colour = (0.30, 0.34, 0.40)
TOOL: Colour = (0.42, 0.45, 0.50)
PEG: Colour = (0.95, 0.62, 0.18)
PLATE: Colour = (0.58, 0.65, 0.74)
CUT: Colour = (0.33, 0.42, 0.56)
FLOOR: Colour = (0.80, 0.82, 0.85)
SHADOW: Colour = (0.66, 0.68, 0.72)
THINNER = 0.8  # share of the collision capsules' radius: these enclose the link with a margin
JOINT_WIDER = 1.08
POST_M = 0.016


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """Meshes that do not change, each in its own frame: the peg in the peg frame, the plate in the hole frame."""

    workcell: Workcell
    peg: DrawnMesh
    plate: DrawnMesh
    plate_cut: DrawnMesh

    @classmethod
    def of(cls, workcell: Workcell) -> Bodies:
        """From the drawings."""
        peg = workcell.peg.shape()
        solid = [convex(piece.vertices_m(), PEG) for piece in peg.pieces()]
        blocks = [piece.vertices_m() for piece in workcell.hole.shape(peg).pieces()]
        plate = [convex(corners, PLATE) for corners in blocks]
        cut = [convex(corners, PLATE, (cut_normal(workcell), 0.0, CUT)) for corners in blocks]
        return cls(workcell, *(joined([mesh for mesh in each if mesh is not None]) for each in (solid, plate, cut)))

    def arm(self, joints_rad: Array | tuple[float, ...]) -> DrawnMesh:
        """The arm and its tool at joint angles (n,), base frame; without the peg."""
        arm = self.workcell.arm()
        poses = arm.link_poses(joints_rad)
        parts = []
        thick = THINNER * np.asarray(arm.link_radii_m)
        for index, (line, radius) in enumerate(zip(arm.link_lines_m, thick, strict=True)):
            start, end = poses[index + 1].apply(line)
            parts.append(capsule(start, end, float(radius), LINK))
            origin, axis = poses[index].translation_m, poses[index].rotation[:, 2]
            half = JOINT_WIDER * float(thick[max(0, index - 1) : index + 1].max())
            parts.append(cylinder(origin - half * axis, origin + half * axis, half, JOINT))
        flange = poses[-1]
        tool_m = self.workcell.surroundings.tool_radius_m
        end = (flange @ self.workcell.pose_flange_peg()).apply([0.0, 0.0, self.workcell.peg.shape().body_start_m])
        if float(np.linalg.norm(end - flange.translation_m)) > 1e-6:
            parts.append(cylinder(flange.translation_m, end, 0.8 * tool_m, TOOL))
        return joined(parts)

    def post(self, hole: Pose) -> DrawnMesh:
        """The post on which the plate stands."""
        depth_m = self.workcell.hole.shape(self.workcell.peg.shape()).depth_m
        top = hole.apply([0.0, 0.0, depth_m / 2.0])
        return cylinder(top * np.array([1.0, 1.0, 0.0]), top, POST_M, TOOL)

    def floor(self, half_m: float = 1.4, pieces: int = 20) -> DrawnMesh:
        """The ground at the height of the base, in small pieces: a piece that reaches behind the eye is not drawn."""
        edges = np.linspace(-half_m, half_m, pieces + 1)
        x, y = (each.ravel() for each in np.meshgrid(edges[:-1], edges[:-1]))
        step = edges[1] - edges[0]
        a, b, c, d = (
            np.stack([x + dx * step, y + dy * step, np.zeros_like(x)], axis=1)
            for dx, dy in ((0, 0), (1, 0), (1, 1), (0, 1))
        )
        return _matt(np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]), FLOOR)


def _matt(triangles_m: Array, colour: Colour) -> DrawnMesh:
    """Triangles that look equally bright from everywhere."""
    return DrawnMesh(triangles_m, np.zeros_like(triangles_m), np.tile(colour, (len(triangles_m), 1)))


def cut_normal(workcell: Workcell) -> Array:
    """Which half of the plate is cut away to show the bore: of the hole's own x and y the direction (3,) that points
    most upwards or, where the hole itself opens upwards, most towards the viewer.
    """
    rotation = workcell.hole_prior.pose_base_hole().rotation
    towards = np.array([0.0, 0.0, 1.0]) if abs(rotation[2, 2]) < 0.7 else np.array([0.0, -1.0, 0.0])
    ways = np.vstack([np.eye(3)[:2], -np.eye(3)[:2]])
    return np.asarray(ways[int(np.argmax(ways @ rotation.T @ towards))])


def shadow(mesh: DrawnMesh, light: Array) -> DrawnMesh:
    """The shadow of a mesh on the ground, drawn slightly above it, under light from `light` (3,)."""
    light = np.asarray(light, float)
    points = mesh.corners_m - mesh.corners_m[..., 2:] / light[2] * light
    points[..., 2] = 0.002
    return _matt(points, SHADOW)


def where_peg_is(workcell: Workcell, joints_rad: Array | tuple[float, ...], wrench: Array | None = None) -> Pose:
    """`pose_base_peg` by the encoders; with a wrench (6,) on the peg, peg frame, deflected by the arm's compliance."""
    pose = workcell.pose_base_peg(joints_rad)
    if wrench is None:
        return pose
    twist = workcell.arm_compliance_peg(joints_rad) @ np.asarray(wrench)
    return pose @ Pose.from_rotvec(twist[3:], twist[:3])
