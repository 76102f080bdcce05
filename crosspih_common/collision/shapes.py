"""Shapes for the collision library, `coal`, the maintained successor of hpp-fcl.

It was chosen over python-fcl by measurement (docs/surroundings.md): its distances agree with the closed form, a query
takes less than half the time, and it gives the depth of an overlap. It comes with `pin`. It is imported when a model is
made, so that only services that check motions need it installed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.collision.fixture import Fixture, upwards
from crosspih_common.collision.moving import MovingPart, along
from crosspih_common.config import Workcell
from crosspih_common.config.surroundings import FIXTURE, FLOOR, STAND, Mesh
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

WITHOUT_FLOOR_M = 1.0  # how far a stand reaches down then
FAR_M = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """A fixed obstacle: its shape, and its bounding box (about `pose_base_box`, half lengths (3,), m)."""

    name: str
    shape: Any
    pose_base: Pose
    pose_base_box: Pose
    half_box_m: Array


def library() -> Any:
    """The collision library; ConfigError where it is not installed."""
    try:
        import coal
    except ImportError as error:
        raise ConfigError(
            f"cell.surroundings: motions cannot be checked without coal ({error}); pip install coal"
        ) from None
    return coal


def shape_of(part: MovingPart) -> Any:
    """The shape of a moving part."""
    coal = library()
    if part.corners_m is not None:
        return hull_of(part.corners_m)
    if part.round_ends:
        return coal.Capsule(part.radius_m, part.length_m)
    return coal.Cylinder(part.radius_m, part.length_m)


def hull_of(corners_m: Array) -> Any:
    """The convex hull of points (k, 3), m."""
    coal = library()
    points = coal.StdVec_Vec3s()
    for corner in corners_m:
        points.append(np.asarray(corner, float))
    return coal.ConvexBase.convexHull(points, False, "")


def obstacles_of(workcell: Workcell, fixture: Fixture) -> list[Obstacle]:
    """All obstacles of a cell; first the fixture and its stand, if it has one."""
    coal = library()
    around = workcell.surroundings
    half = (fixture.upper_m - fixture.lower_m) / 2
    pose = fixture.pose_base_hole @ Pose.from_translation((fixture.upper_m + fixture.lower_m) / 2)
    found = [Obstacle(FIXTURE, coal.Box(*(2 * half)), pose, pose, half)]
    stand = _stand(workcell, fixture)
    if stand is not None:
        pose, radius, length = stand
        found.append(Obstacle(STAND, coal.Cylinder(radius, length), pose, pose, np.array([radius, radius, length / 2])))
    if around.floor_height_m is not None:
        up = upwards(workcell)
        pose, _ = along(up * around.floor_height_m - up * FAR_M, up * around.floor_height_m)
        half = np.array([FAR_M, FAR_M, FAR_M / 2])
        floor = coal.Halfspace(np.array([0.0, 0.0, 1.0]), FAR_M / 2)
        found.append(Obstacle(FLOOR, floor, pose, pose, half))
    for box in (*around.boxes, *around.keep_out):
        half = np.asarray(box.size_m) / 2
        found.append(Obstacle(box.name, coal.Box(*box.size_m), box.pose(), box.pose(), half))
    for one in around.cylinders:
        half = np.array([one.radius_m, one.radius_m, one.length_m / 2])
        found.append(Obstacle(one.name, coal.Cylinder(one.radius_m, one.length_m), one.pose(), one.pose(), half))
    for index, mesh in enumerate(around.meshes):
        found.append(_mesh(mesh, f"cell.surroundings.meshes.{index}"))
    return found


def _stand(workcell: Workcell, fixture: Fixture) -> tuple[Pose, float, float] | None:
    """The stand's middle, radius and length, from the lower edge of the plate as drawn down to the floor."""
    if fixture.stand_radius_m is None:
        return None
    up = upwards(workcell)
    half = (fixture.plate_upper_m - fixture.plate_lower_m) / 2
    centre = fixture.pose_base_hole.apply((fixture.plate_upper_m + fixture.plate_lower_m) / 2)
    top = centre - up * float(half @ np.abs(fixture.pose_base_hole.rotation.T @ up))
    floor_m = workcell.surroundings.floor_height_m
    height = WITHOUT_FLOOR_M if floor_m is None else float(top @ up) - floor_m
    if height <= 1e-3:
        return None
    pose, length = along(top - height * up, top)
    return pose, fixture.stand_radius_m, length


def _mesh(mesh: Mesh, field: str) -> Obstacle:
    coal = library()
    if not Path(mesh.file).is_file():
        raise ConfigError(f"{field}.file: {mesh.file} is not there; put the mesh beside the cell's file")
    try:
        shape = coal.MeshLoader().load(mesh.file, np.full(3, mesh.scale))
        corners = np.asarray(shape.vertices(), float)
        if mesh.hull:
            shape = hull_of(corners)
    except ValueError as error:
        reason = " ".join(str(error).split("message:")[-1].split())
        raise ConfigError(f"{field}.file: {mesh.file} is no mesh that can be read: {reason}") from None
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    box = mesh.pose() @ Pose.from_translation((lower + upper) / 2)
    return Obstacle(mesh.name, shape, mesh.pose(), box, (upper - lower) / 2)
