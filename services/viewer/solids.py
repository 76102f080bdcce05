"""Triangle meshes of the bodies in a cell: capsules, cylinders, boxes, pegs, plates with a hole, ellipsoids."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from crosspih_common.geometry.pose import Array, Pose
from crosspih_common.shapes import Hole, Outline, Peg

Faces = NDArray[np.uint32]
AROUND = 28  # corners of a full circle
BANDS = 7  # of a half sphere


@dataclass(frozen=True, slots=True, eq=False)
class SolidMesh:
    """Corners (n, 3), m, and triangles (k, 3) of them, counter-clockwise seen from outside."""

    corners_m: Array
    faces: Faces

    def moved(self, pose: Pose) -> SolidMesh:
        """The same mesh moved to `pose`."""
        return SolidMesh(pose.apply(self.corners_m), self.faces)


def joined(meshes: list[SolidMesh]) -> SolidMesh:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(mesh.corners_m) for mesh in meshes[:-1])])
    faces = [mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=True)]
    return SolidMesh(np.vstack([mesh.corners_m for mesh in meshes]), np.vstack(faces))


def frame_along(start_m: ArrayLike, end_m: ArrayLike) -> tuple[Pose, float]:
    """A frame in the middle of two points (3,), m, its z from the first to the second; and their distance, m."""
    start = np.asarray(start_m, float)
    way = np.asarray(end_m, float) - start
    length = float(np.linalg.norm(way))
    if length < 1e-9:
        return Pose.from_translation(start), 0.0
    axis = way / length
    aside = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    aside /= np.linalg.norm(aside)
    return Pose(np.column_stack([aside, np.cross(axis, aside), axis]), start + way / 2), length


def revolved(profile_m: ArrayLike) -> SolidMesh:
    """A profile of (radius, z) rows (k, 2), m, from below to above, turned about z; the ends lie on the axis."""
    profile = np.asarray(profile_m, float)
    angles = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    rings = np.stack(
        [
            profile[:, :1] * np.cos(angles),
            profile[:, :1] * np.sin(angles),
            np.broadcast_to(profile[:, 1:], (len(profile), AROUND)),
        ],
        axis=-1,
    )
    here, there = np.arange(AROUND), np.roll(np.arange(AROUND), -1)
    faces = []
    for ring in range(len(profile) - 1):
        low, high = ring * AROUND, (ring + 1) * AROUND
        faces.append(np.column_stack([low + here, low + there, high + there]))
        faces.append(np.column_stack([low + here, high + there, high + here]))
    return SolidMesh(rings.reshape(-1, 3), np.vstack(faces).astype(np.uint32))


def capsule(start_m: ArrayLike, end_m: ArrayLike, radius_m: float) -> SolidMesh:
    """A cylinder with round ends about the line from `start_m` to `end_m` (3,), m; a ball where the two are equal."""
    pose, length = frame_along(start_m, end_m)
    up = np.linspace(0.0, np.pi / 2, BANDS + 1)
    top = np.column_stack([radius_m * np.cos(up), length / 2 + radius_m * np.sin(up)])
    bottom = top[::-1] * [1.0, -1.0]
    return revolved(np.vstack([bottom, top])).moved(pose)


def cylinder(start_m: ArrayLike, end_m: ArrayLike, radius_m: float, bevel_m: float = 0.0) -> SolidMesh:
    """A cylinder from `start_m` to `end_m` (3,), m, its edges broken by `bevel_m`."""
    pose, length = frame_along(start_m, end_m)
    half, inner = length / 2, radius_m - bevel_m
    ring = [(0.0, -half), (inner, -half), (inner, -half), (radius_m, bevel_m - half), (radius_m, bevel_m - half)]
    profile = [*ring, *((r, -z) for r, z in reversed(ring))]
    return revolved(profile).moved(pose)


def box(size_m: ArrayLike) -> SolidMesh:
    """A box about the origin; `size_m` (3,) are its whole lengths."""
    square = Outline.of("box", np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]))
    mesh = _prism(shapely.Polygon(square.corners_m), -0.5, 0.5)
    return SolidMesh(mesh.corners_m * np.asarray(size_m, float), mesh.faces)


def ellipsoid(covariance_m2: ArrayLike, sigmas: float) -> SolidMesh:
    """The surface `sigmas` standard deviations about the origin of a covariance (3, 3), m^2."""
    values, axes = np.linalg.eigh(np.asarray(covariance_m2, float))
    up = np.linspace(-np.pi / 2, np.pi / 2, 2 * BANDS + 1)
    ball = revolved(np.column_stack([np.cos(up), np.sin(up)]))
    if np.linalg.det(axes) < 0.0:
        axes = axes * [1.0, 1.0, -1.0]
    return SolidMesh(ball.corners_m * (sigmas * np.sqrt(np.maximum(values, 0.0))) @ axes.T, ball.faces)


def peg_mesh(peg: Peg) -> SolidMesh:
    """The peg in the peg frame: its outline from where the body starts, and the taper."""
    heights = [peg.body_start_m, peg.taper_start_m, peg.tip_m]
    walls = _walls([peg.outline_m(height) for height in heights])
    section = shapely.Polygon(peg.outline.corners_m)
    low = _cap(section, peg.body_start_m, upwards=False)
    scale = float(peg.scale_at(peg.tip_m))
    tip = _cap(shapely.affinity.scale(section, scale, scale, origin=(0.0, 0.0)), peg.tip_m, upwards=True)
    return joined([*walls, low, tip])


def plate_mesh(hole: Hole) -> SolidMesh:
    """The plate in the hole frame, z into the hole: its opening, the chamfer and the bore."""
    half = hole.plate_half_size_m
    square = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    opening, bore = hole.opening().corners_m, hole.outline.corners_m
    face = _cap(shapely.Polygon(square, [opening]), 0.0, upwards=False)
    back = _cap(shapely.Polygon(square, [bore]), hole.depth_m, upwards=True)
    outside = _walls([_at(square, 0.0), _at(square, hole.depth_m)])
    inside = _walls([_at(opening, 0.0), _at(bore, hole.chamfer_m), _at(bore, hole.depth_m)])
    turned = [SolidMesh(mesh.corners_m, np.ascontiguousarray(mesh.faces[:, ::-1])) for mesh in inside]
    return joined([face, back, *outside, *turned])


def _at(corners_m: Array, z_m: float) -> Array:
    return np.column_stack([corners_m, np.full(len(corners_m), z_m)])


def _walls(rings: list[Array]) -> list[SolidMesh]:
    """The walls between rings of corners (n, 3), from below to above; each wall has its own corners, for
    sharp edges.
    """
    meshes = []
    for low, high in pairwise(rings):
        count = len(low)
        corners = np.stack([low, np.roll(low, -1, axis=0), np.roll(high, -1, axis=0), high], axis=1).reshape(-1, 3)
        first = 4 * np.arange(count, dtype=np.uint32)[:, None]
        faces = np.vstack([first + np.array([0, 1, 2], np.uint32), first + np.array([0, 2, 3], np.uint32)])
        meshes.append(SolidMesh(corners, faces.astype(np.uint32)))
    return meshes


def _cap(polygon: shapely.Polygon, z_m: float, upwards: bool) -> SolidMesh:
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    corners = np.array([np.asarray(triangle.exterior.coords)[:3] for triangle in triangles])
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    clockwise = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    turn = clockwise if upwards else ~clockwise
    corners[turn] = corners[turn][:, ::-1]
    flat = _at(corners.reshape(-1, 2), z_m)
    return SolidMesh(flat, np.arange(len(flat), dtype=np.uint32).reshape(-1, 3))


def _prism(polygon: shapely.Polygon, low_m: float, high_m: float) -> SolidMesh:
    ring = np.asarray(polygon.exterior.coords)[:-1]
    if not polygon.exterior.is_ccw:
        ring = ring[::-1]
    return joined(
        [
            *_walls([_at(ring, low_m), _at(ring, high_m)]),
            _cap(polygon, low_m, upwards=False),
            _cap(polygon, high_m, upwards=True),
        ]
    )
