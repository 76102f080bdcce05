"""Meshes to pixels: OpenCV's z-buffer, light from one side, edges smoothed by drawing larger than shown."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.operator.scene3d.meshes import Colour, DrawnMesh

FINER = 2  # pixels drawn for each pixel shown, in each direction
NEAR_M, FAR_M = 0.05, 5.0
AMBIENT, DIFFUSE, GLOSS = 0.42, 0.58, 0.18
Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """The camera: `eye_m` and `target_m` (3,) in the base frame, `up` (3,), and the vertical angle of view."""

    eye_m: tuple[float, float, float]
    target_m: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    angle_deg: float = 35.0

    def camera_of_world(self) -> Array:
        """(4, 4), OpenGL's camera: x right, y up, z towards the eye."""
        eye = np.asarray(self.eye_m)
        back = eye - self.target_m
        back = back / np.linalg.norm(back)
        right = np.cross(self.up, back)
        right = right / np.linalg.norm(right)
        matrix = np.eye(4)
        matrix[:3, :3] = np.stack([right, np.cross(back, right), back])
        matrix[:3, 3] = -matrix[:3, :3] @ eye
        return matrix

    def pixels(self, points_m: Array, size: tuple[int, int]) -> Array:
        """The pixels (n, 2), y down, of points (n, 3), m, base frame, in a picture of (width, height)."""
        width, height = size
        matrix = self.camera_of_world()
        x, y, z = (np.asarray(points_m) @ matrix[:3, :3].T + matrix[:3, 3]).T
        scale = height / 2.0 / np.tan(np.radians(self.angle_deg) / 2.0)
        return np.stack([width / 2.0 - scale * x / z, height / 2.0 + scale * y / z], axis=1)


def can_draw() -> bool:
    """Whether this OpenCV can draw: version 5 or later."""
    return hasattr(cv2, "triangleRasterize")


def draw(mesh: DrawnMesh, view: Viewpoint, size: tuple[int, int], background: Colour, light: Array) -> Picture:
    """The picture (height, width, 3), uint8 RGB, of a mesh under light from the direction `light` (3,)."""
    width, height = size[0] * FINER, size[1] * FINER
    colours = np.full((height, width, 3), background, dtype=np.float32)
    depths = np.full((height, width), FAR_M, dtype=np.float32)
    corners = mesh.corners_m.reshape(-1, 3).astype(np.float32)
    settings = cv2.TriangleRasterizeSettings()
    settings.setShadingType(cv2.RASTERIZE_SHADING_SHADED)
    settings.setCullingMode(cv2.RASTERIZE_CULLING_NONE)
    cv2.triangleRasterize(
        corners[None], np.arange(len(corners), dtype=np.int32).reshape(1, -1, 3), _lit(mesh, view, light)[None],
        colours, depths, view.camera_of_world().astype(np.float32), float(np.radians(view.angle_deg)), NEAR_M, FAR_M,
        settings,
    )  # fmt: skip
    shown = cv2.resize(colours, size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(np.clip(shown * 255.0, 0.0, 255.0).astype(np.uint8))


def _lit(mesh: DrawnMesh, view: Viewpoint, light: Array) -> NDArray[np.float32]:
    """A colour (3 n, 3) for each corner: Lambert's law, some light from everywhere, and a little gloss."""
    light = np.asarray(light, float) / np.linalg.norm(light)
    normals = mesh.normals.reshape(-1, 3)
    matt = np.all(normals == 0.0, axis=1)[:, None]  # the ground and shadows on it are equally bright everywhere
    towards = np.asarray(view.eye_m) - mesh.corners_m.reshape(-1, 3)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    # a wall seen from inside is lit like one seen from outside
    normals = normals * np.sign(np.sum(normals * towards, axis=1, keepdims=True) + 1e-12)
    between = light + towards
    between /= np.linalg.norm(between, axis=1, keepdims=True)
    gloss = np.clip(np.sum(normals * between, axis=1), 0.0, 1.0) ** 24
    shade = AMBIENT + DIFFUSE * np.clip(normals @ light, 0.0, 1.0)
    colours = np.repeat(mesh.colours, 3, axis=0)
    lit = np.where(matt, colours, colours * shade[:, None] + GLOSS * gloss[:, None])
    return np.clip(lit, 0.0, 1.0).astype(np.float32)
