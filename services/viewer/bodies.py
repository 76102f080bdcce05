"""The bodies that are drawn of a cell, from its file alone: arm, sensor, peg, plate, surroundings, cameras."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.config.surroundings import Mesh as MeshFile
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, CameraModel, PoseData
from services.viewer.solids import SolidMesh, box, capsule, cylinder, joined, peg_mesh, plate_mesh

Colour = tuple[int, int, int]
ARM, JOINT, STEEL, SENSOR = (236, 238, 241), (58, 68, 84), (150, 157, 168), (38, 42, 50)
BRASS, PLATE, STAND, THING, FORBIDDEN = (222, 164, 58), (126, 138, 156), (92, 100, 112), (176, 164, 146), (206, 66, 66)
HOUSING = 1.22  # radius of a joint's housing over that of the link that it carries
BARREL = 1.25  # half the housing's length over the radius of that link
SMOOTH_M = 0.006
SENSOR_LENGTH_M = 0.033  # length of a wrist sensor, at most; the rest of the tool carries the peg
BASE_M = 0.035


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A thing to draw, fixed to a frame: "base", "peg", "hole", or "link k", which the first k joints move."""

    name: str
    frame: str
    mesh: SolidMesh
    colour: Colour
    opacity: float = 1.0
    sharp: bool = False


def link_frame(index: int) -> str:
    """The frame after the first `index` joints."""
    return f"link {index}"


def bodies_of(workcell: Workcell) -> list[Body]:
    """Everything that a cell's file describes, m."""
    return [*_arm(workcell), *_tool(workcell), *_fixture(workcell), *_around(workcell)]


def frames_of(workcell: Workcell, joints_rad: Array) -> dict[str, Pose]:
    """`pose_base_frame` of everything that the arm moves: its links, and the peg."""
    poses = workcell.arm().link_poses(joints_rad)
    frames = {link_frame(index): pose for index, pose in enumerate(poses)}
    frames["peg"] = poses[-1] @ workcell.pose_flange_peg()
    return frames


def _arm(workcell: Workcell) -> list[Body]:
    """Each link is a capsule, bent where the drawing goes along the axis first and then away; each axis
    has a barrel.
    """
    arm = workcell.arm()
    foot_m = workcell.surroundings.floor_height_m or 0.0
    bodies = []
    radii = [float(radius) for radius in arm.link_radii_m]
    for index, (line, radius) in enumerate(zip(arm.link_lines_m, radii, strict=True)):
        path = [line[0], line[1]]
        if index == 0:  # the base holds the link's lower end, so that it does not stand out below
            path[0] = line[0] + (line[1] - line[0]) * min((radius + foot_m) / np.linalg.norm(line[1] - line[0]), 0.9)
        if arm.table is not None:
            corner = np.array([-arm.table[index, 2], 0.0, 0.0])
            path.insert(1, corner)
        pieces = [
            capsule(start, end, radius * 0.92) for start, end in pairwise(path) if np.linalg.norm(end - start) > 1e-3
        ]
        if pieces:
            bodies.append(Body(f"arm/link {index + 1}", link_frame(index + 1), joined(pieces), ARM))
    # frame k's z is the axis of joint k + 1, which link k + 1 turns about
    for index in range(1, arm.joints):
        radius = radii[index] * HOUSING
        half = np.array([0.0, 0.0, radius * BARREL])
        barrel = cylinder(-half, half, radius, bevel_m=radius / 6)
        bodies.append(Body(f"arm/joint {index + 1}", link_frame(index), barrel, JOINT))
    wide = radii[0] * 1.45
    foot = cylinder([0.0, 0.0, foot_m], [0.0, 0.0, foot_m + BASE_M], wide, bevel_m=0.006)
    column = cylinder([0.0, 0.0, foot_m], [0.0, 0.0, foot_m + 0.14], radii[0] * 1.15, bevel_m=0.012)
    bodies.append(Body("arm/base", "base", joined([foot, column]), JOINT))
    return bodies


def _tool(workcell: Workcell) -> list[Body]:
    peg = workcell.peg.shape()
    pose_flange_peg = workcell.pose_flange_peg()
    flange, wrist = link_frame(workcell.arm().joints), np.zeros(3)
    ahead = pose_flange_peg.apply([0.0, 0.0, peg.body_start_m])
    length = float(np.linalg.norm(ahead))
    radius = workcell.surroundings.tool_radius_m
    reach = ahead * min(1.0, SENSOR_LENGTH_M / max(length, 1e-6))
    collar = peg.outline.radius_m * 1.06
    bodies = [Body("tool/sensor", flange, cylinder(wrist, reach, radius, bevel_m=0.003), SENSOR)]
    if length > SENSOR_LENGTH_M:
        holder = joined(
            [cylinder(reach, ahead, radius * 0.72, 0.003), cylinder(reach * 0.9, reach * 1.12, radius * 0.9)]
        )
        bodies.append(Body("tool/holder", flange, holder, STEEL))
    foot = np.array([0.0, 0.0, peg.body_start_m])
    back, front = np.array([0.0, 0.0, -0.008]), np.array([0.0, 0.0, 0.004])
    grip = cylinder(foot + back, foot + front, min(collar, radius), bevel_m=0.002)
    bodies.append(Body("tool/grip", "peg", grip, STEEL))
    bodies.append(Body("peg", "peg", peg_mesh(peg), BRASS, sharp=True))
    return bodies


def _fixture(workcell: Workcell) -> list[Body]:
    hole = workcell.hole.shape(workcell.peg.shape())
    bodies = [Body("platform/plate", "hole", plate_mesh(hole), PLATE, sharp=True)]
    stand_m = workcell.surroundings.stand_radius_m
    pose = workcell.hole_prior.pose_base_hole()
    up = upwards(workcell)
    if stand_m is None or float(pose.rotation[:, 2] @ up) > np.cos(np.pi / 4):
        return bodies
    half = np.array([hole.plate_half_size_m, hole.plate_half_size_m, hole.depth_m / 2])
    centre = pose.apply([0.0, 0.0, hole.depth_m / 2])
    top = centre - up * float(half @ np.abs(pose.rotation.T @ up)) * 0.96
    floor_m = workcell.surroundings.floor_height_m
    height = float(top @ up) - (floor_m if floor_m is not None else float(top @ up) - 1.0)
    if height > 1e-3:
        foot = top - height * up
        column = joined([cylinder(foot, top, stand_m * 0.55, 0.002), cylinder(foot, foot + 0.012 * up, stand_m, 0.003)])
        bodies.append(Body("platform/stand", "base", column, STAND))
    return bodies


def upwards(workcell: Workcell) -> Array:
    """The unit vector (3,) against gravity, base frame."""
    gravity = np.asarray(workcell.gravity_base_m_s2)
    return np.asarray(-gravity / np.linalg.norm(gravity), dtype=float)


def _around(workcell: Workcell) -> list[Body]:
    around = workcell.surroundings
    bodies = [
        Body(f"surroundings/{one.name}", "base", box(one.size_m).moved(one.pose()), THING, sharp=True)
        for one in around.boxes
    ]
    for one in around.cylinders:
        half = np.array([0.0, 0.0, one.length_m / 2])
        mesh = cylinder(-half, half, one.radius_m).moved(one.pose())
        bodies.append(Body(f"surroundings/{one.name}", "base", mesh, THING))
    for kept in around.keep_out:
        mesh = box(kept.size_m).moved(kept.pose())
        bodies.append(Body(f"keep out/{kept.name}", "base", mesh, FORBIDDEN, opacity=0.18, sharp=True))
    for placed in around.meshes:
        if (found := _of_file(placed)) is not None:
            bodies.append(Body(f"surroundings/{placed.name}", "base", found, THING, sharp=True))
    return bodies


def _of_file(placed: MeshFile) -> SolidMesh | None:
    """A mesh of the cell's file; None where the mesh file is not on this machine, as with a recording
    from elsewhere.
    """
    import trimesh  # viser depends on it

    if not Path(placed.file).is_file():
        return None
    try:
        found = trimesh.load_mesh(placed.file)
    except (ValueError, OSError, NotImplementedError):
        return None
    if placed.hull:
        found = found.convex_hull
    corners = np.asarray(found.vertices, float) * placed.scale
    return SolidMesh(placed.pose().apply(corners), np.asarray(found.faces, np.uint32))


def cameras_of(workcell: Workcell, told: CameraCalibration | None) -> list[tuple[str, CameraModel, Pose]]:
    """Name, model and `pose_base_camera` of both cameras: as the driver publishes them, or else from the
    cell's file.
    """
    if told is None:
        drawn = workcell.camera
        model = CameraModel(
            width_px=drawn.width_px, height_px=drawn.height_px, fx_px=drawn.fx_px, fy_px=drawn.fy_px,
            cx_px=drawn.cx_px, cy_px=drawn.cy_px,
        )  # fmt: skip
        right = PoseData.of(Pose.from_translation([drawn.baseline_m, 0.0, 0.0]))
        told = CameraCalibration(
            left=model, right=model, pose_left_right=right, pose_base_camera=PoseData.of(drawn.pose_base_camera())
        )
    left = told.pose_base_camera.pose()
    return [("left", told.left, left), ("right", told.right, left @ told.pose_left_right.pose())]


def seated_peg(workcell: Workcell, pose_base_hole: Pose) -> Pose:
    """`pose_base_peg` of a peg seated in a hole there, its body in as deep as counts as inserted."""
    depth_m = workcell.hole.shape(workcell.peg.shape()).chamfer_m + workcell.insertion_depth_m
    return pose_base_hole @ Pose.from_translation([0.0, 0.0, depth_m - workcell.peg.shape().taper_start_m])
