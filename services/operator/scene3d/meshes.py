"""Meshes of simple bodies. Triangles as corners with one normal each, so that round bodies look round. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

Colour = tuple[float, float, float]
SIDES, RINGS = 20, 4


@dataclass(frozen=True, slots=True, eq=False)
class DrawnMesh:
    """Triangles: `corners_m` (n, 3, 3) and the outward unit `normals` there (n, 3, 3); `colours` (n, 3), 0 to 1."""

    corners_m: Array
    normals: Array
    colours: Array

    def at(self, pose: Pose) -> DrawnMesh:
        """The same body, with its frame at a pose."""
        return DrawnMesh(
            self.corners_m @ pose.rotation.T + pose.translation_m, self.normals @ pose.rotation.T, self.colours
        )

    def painted(self, colour: Colour) -> DrawnMesh:
        """The same body in one colour."""
        return DrawnMesh(self.corners_m, self.normals, np.tile(colour, (len(self.corners_m), 1)))


def joined(meshes: Sequence[DrawnMesh]) -> DrawnMesh:
    """Several bodies as one; none of them may be missing."""
    return DrawnMesh(
        np.concatenate([mesh.corners_m for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.colours for mesh in meshes]),
    )


def flat(triangles_m: Array, colour: Colour) -> DrawnMesh:
    """Triangles (n, 3, 3), counter-clockwise seen from outside, each with its own normal."""
    normals = np.cross(triangles_m[:, 1] - triangles_m[:, 0], triangles_m[:, 2] - triangles_m[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(lengths > 0.0, lengths, 1.0)
    return DrawnMesh(triangles_m, np.repeat(normals[:, None, :], 3, axis=1), np.tile(colour, (len(triangles_m), 1)))


def convex(corners_m: Array, colour: Colour, cut: tuple[Array, float, Colour] | None = None) -> DrawnMesh | None:
    """The convex hull of corners (n, 3); with `cut` (normal (3,), offset in m, colour) its part where normal . p <=
    offset, with the cut face in that colour. None where nothing is left.
    """
    from scipy.spatial import ConvexHull, QhullError

    if cut is not None:
        normal, offset_m, _ = cut
        over = corners_m @ normal - offset_m
        inside, outside = np.flatnonzero(over <= 0.0), np.flatnonzero(over > 0.0)
        a, b = (index.ravel() for index in np.meshgrid(inside, outside, indexing="ij"))
        share = (over[a] / (over[a] - over[b]))[:, None]
        # where lines between kept and removed corners meet the plane: all of these points are in the body, because it
        # is convex
        corners_m = np.concatenate([corners_m[inside], corners_m[a] + share * (corners_m[b] - corners_m[a])])
    try:
        hull = ConvexHull(corners_m)
    except (ValueError, QhullError):
        return None  # empty, or too thin to be seen
    triangles = corners_m[hull.simplices]
    normals = hull.equations[:, :3]
    mesh = DrawnMesh(triangles, np.repeat(normals[:, None, :], 3, axis=1), np.tile(colour, (len(triangles), 1)))
    if cut is not None:
        mesh.colours[normals @ cut[0] > 1.0 - 1e-6] = cut[2]
    return mesh


def capsule(start_m: Array, end_m: Array, radius_m: float, colour: Colour) -> DrawnMesh:
    """A capsule about the line between two points (3,), m."""
    way = np.asarray(end_m, float) - start_m
    length = float(np.linalg.norm(way))
    axis = way / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    latitudes = np.linspace(-np.pi / 2, np.pi / 2, 2 * RINGS)
    along = np.where(latitudes > 0.0, length, 0.0) + radius_m * np.sin(latitudes)
    return _turned(start_m, axis, along, radius_m * np.cos(latitudes), np.sin(latitudes), colour)


def cylinder(start_m: Array, end_m: Array, radius_m: float, colour: Colour) -> DrawnMesh:
    """A cylinder about the line between two points (3,), m, with flat ends."""
    way = np.asarray(end_m, float) - start_m
    length = float(np.linalg.norm(way))
    axis = way / length
    along = np.array([0.0, 0.0, 0.0, length, length, length])
    across = np.array([0.0, 1.0, 1.0, 1.0, 1.0, 0.0]) * radius_m
    slopes = np.array([-1.0, -1.0, 0.0, 0.0, 1.0, 1.0])
    return _turned(start_m, axis, along, across, slopes, colour)


def _turned(start_m: Array, axis: Array, along_m: Array, across_m: Array, slopes: Array, colour: Colour) -> DrawnMesh:
    """A body of revolution about an axis (3,): rings at `along_m` with radii `across_m` and normals inclined by
    `slopes`.
    """
    aside = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    aside /= np.linalg.norm(aside)
    other = np.cross(axis, aside)
    angles = np.linspace(0.0, 2.0 * np.pi, SIDES + 1)
    outward = np.cos(angles)[:, None] * aside + np.sin(angles)[:, None] * other
    points = start_m + along_m[:, None, None] * axis + across_m[:, None, None] * outward
    level = np.sqrt(np.clip(1.0 - slopes**2, 0.0, 1.0))
    normals = slopes[:, None, None] * axis + level[:, None, None] * outward

    def faces(grid: Array) -> Array:
        a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
        return np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)

    corners = faces(points)
    return DrawnMesh(corners, faces(normals), np.tile(colour, (len(corners), 1)))
