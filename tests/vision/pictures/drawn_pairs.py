"""Pairs drawn with polygons: any outline, any greys on face, chamfer, walls and bottom, texture, glints, what covers.

No light is modelled: each facet has the grey it is given. Exact in where things are, free in how they look.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole
from services.vision.stereo import StereoModel

Floats = NDArray[np.float32]
FINE = 4  # sub-pixels a side; fewer for a large picture
BITS = 6


@dataclass(frozen=True, slots=True)
class Look:
    """Greys, 0 to 255. A facet of the chamfer or a wall has its mean grey, more or less by its direction: `relief`
    times the cosine from `light_rad`. `marks`: milled lines on the face along `marks_rad`, one sd as a share of it.
    `gradient`: the face's grey changes by that share over 60 mm along `light_rad`. `glints`: bright spots near the rim.
    `covered`: share of the rim hidden by something flat above the face. `through`: the background is seen inside.
    `half_bright`: the grey of half of what is at the hole's bottom."""

    face: float = 170.0
    chamfer: float = 110.0
    wall: float = 60.0
    bottom: float = 20.0
    background: float = 10.0
    relief: float = 0.3
    light_rad: float = 0.7
    marks: float = 0.0
    marks_rad: float = 0.0
    gradient: float = 0.0
    glints: int = 0
    covered: float = 0.0
    through: bool = False
    half_bright: float | None = None
    clutter: int = 0
    blur_px: float = 0.7
    noise: float = 3.0
    seed: int = 0
    sizes: tuple[tuple[int, int], tuple[int, int]] = field(default=((640, 480), (640, 480)))


def drawn_pair(stereo: StereoModel, hole: Hole, pose_camera_hole: Pose, look: Look) -> tuple[Floats, Floats]:
    """Left and right picture (height, width), grey 0 to 255, linear."""
    return _drawn(stereo, hole, pose_camera_hole, look, 0), _drawn(stereo, hole, pose_camera_hole, look, 1)


def _drawn(stereo: StereoModel, hole: Hole, pose: Pose, look: Look, side: int) -> Floats:
    rng = np.random.default_rng(look.seed)
    width, height = look.sizes[side]
    reach = hole.plate_half_size_m * np.array([[-1.2, -1.2, 0], [1.2, -1.2, 0], [1.2, 1.2, 0], [-1.2, 1.2, 0]])
    corners_px = stereo.project(pose.apply(reach))[side]
    low = np.clip(np.floor(corners_px.min(axis=0)), 0, [width, height]).astype(int)
    high = np.clip(np.ceil(corners_px.max(axis=0)), 0, [width, height]).astype(int)
    fine = np.full(((high[1] - low[1]) * FINE, (high[0] - low[0]) * FINE), look.background, dtype=np.float32)

    def polygon(points_m: Array) -> Array:
        ends = np.roll(points_m, -1, axis=0)
        share = np.linspace(0.0, 1.0, 8, endpoint=False)[None, :, None]
        line = points_m[:, None] * (1.0 - share) + ends[:, None] * share
        seen = stereo.project(pose.apply(line.reshape(-1, 3)))[side]
        return np.asarray(np.rint(((seen - low + 0.5) * FINE - 0.5) * 2**BITS), dtype=np.int32)

    def fill(picture: Floats, points_m: Array, grey: float) -> None:
        cv2.fillPoly(picture, [polygon(points_m)], float(grey), shift=BITS)

    def relief(outward: Array) -> float:
        light = np.array([np.cos(look.light_rad), np.sin(look.light_rad)])
        return 1.0 + look.relief * float(-outward[:2] @ light)

    def clutter(where_z: float, reach: float, count: int) -> None:
        for _ in range(count):
            middle, half = rng.uniform(-reach, reach, 2), rng.uniform(0.004, 0.02, 2)
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half + middle
            fill(fine, np.column_stack([corners, np.full(4, where_z)]), rng.uniform(5.0, 230.0))

    clutter(0.12, 0.12, look.clutter)
    half = hole.plate_half_size_m
    square = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    face_mask = np.zeros(fine.shape, dtype=np.uint8)
    cv2.fillPoly(face_mask, [polygon(square)], 1, shift=BITS)
    behind = fine.copy()
    box = cv2.boundingRect(face_mask)
    part = (slice(box[1], box[1] + box[3]), slice(box[0], box[0] + box[2]))
    texture = _face(look, stereo, pose, box[3], box[2], rng)
    fine[part] = np.where(face_mask[part] > 0, texture, fine[part])
    outer, inner = hole.outer_rim_m(), hole.inner_rim_m()
    along = np.roll(inner, -1, axis=0) - inner
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    outward = np.column_stack([along[:, 1], -along[:, 0], 0.0 * along[:, 0]])
    count = len(inner)
    for i in range(count):
        j = (i + 1) % count
        fill(fine, np.array([outer[i], outer[j], inner[j], inner[i]]), look.chamfer * relief(outward[i]))
    inside = np.zeros(fine.shape, dtype=np.uint8)
    cv2.fillPoly(inside, [polygon(inner)], 1, shift=BITS)
    deep = behind
    floor = inner + np.array([0.0, 0.0, hole.depth_m - hole.chamfer_m])
    if not look.through:
        deep = np.full_like(fine, look.bottom)
    if look.half_bright is not None:
        reach = np.array([[0.0, -0.2], [0.2, -0.2], [0.2, 0.2], [0.0, 0.2]])
        fill(deep, np.column_stack([reach, np.full(4, hole.depth_m)]), look.half_bright)
    camera = pose.inverse().apply([np.zeros(3), stereo.pose_left_right.translation_m][side])
    middles = 0.5 * (inner + np.roll(floor, -1, axis=0))
    for i in np.argsort(np.linalg.norm(middles - camera, axis=1))[::-1]:
        j = (i + 1) % count
        if float(-outward[i] @ (camera - inner[i])) > 0.0:
            fill(deep, np.array([inner[i], inner[j], floor[j], floor[i]]), look.wall * relief(outward[i]))
    fine = np.where(inside > 0, deep, fine)
    for _ in range(look.glints):
        at = rng.uniform(-1.0, 1.0, 2) * hole.outline.reach_m * 1.2
        turn, size = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False), rng.uniform(0.001, 0.006)
        spot = np.column_stack([at[0] + size * np.cos(turn), at[1] + 0.4 * size * np.sin(turn), np.zeros(12)])
        fill(fine, spot, 255.0)
    if look.covered:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        direction = np.array([np.cos(angle), np.sin(angle)])
        edge = float(np.quantile(_even(outer)[:, :2] @ direction, 1.0 - look.covered))
        corners = np.array([[edge, -0.2], [edge + 0.03, -0.2], [edge + 0.03, 0.2], [edge, 0.2]])
        turned = np.column_stack([corners @ np.array([direction, [-direction[1], direction[0]]]), np.full(4, -0.004)])
        fill(fine, turned, rng.uniform(5.0, 250.0))
    coarse = np.full((height, width), look.background, dtype=np.float32)
    drawn_px = (int(high[0] - low[0]), int(high[1] - low[1]))
    coarse[low[1] : high[1], low[0] : high[0]] = cv2.resize(fine, drawn_px, interpolation=cv2.INTER_AREA)
    coarse = np.asarray(cv2.GaussianBlur(coarse, (0, 0), look.blur_px), dtype=np.float32)
    noise = np.random.default_rng([look.seed, side]).normal(size=coarse.shape) * look.noise
    return np.asarray(np.clip(np.rint(coarse + noise), 0.0, 255.0), dtype=np.float32)


def _face(look: Look, stereo: StereoModel, pose: Pose, height: int, width: int, rng: np.random.Generator) -> Floats:
    """The plate's own grey (height, width) in sub-pixels."""
    ends = stereo.project(pose.apply(np.array([[-0.06, 0.0, 0.0], [0.06, 0.0, 0.0]])))[0]
    scale = float(np.linalg.norm(ends[1] - ends[0])) * FINE / 0.12
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    x, y = (u - width / 2) / scale, (v - height / 2) / scale
    grey = np.full((height, width), look.face, dtype=np.float32)
    grey *= 1.0 + look.gradient * (x * np.cos(look.light_rad) + y * np.sin(look.light_rad)) / 0.06
    if look.marks:
        across = -x * np.sin(look.marks_rad) + y * np.cos(look.marks_rad)
        lines = rng.normal(size=2000)
        place = np.clip((across + 0.15) / 0.0006, 0, 1998)
        grey *= 1.0 + look.marks * np.interp(place.ravel(), np.arange(2000), lines).reshape(grey.shape)
    return np.asarray(np.clip(grey, 0.0, 255.0), dtype=np.float32)


def _even(corners_m: Array) -> Array:
    """Points evenly along a closed outline."""
    ends = np.roll(corners_m, -1, axis=0)
    length = np.linalg.norm(ends - corners_m, axis=1)
    at = np.linspace(0.0, length.sum(), 400, endpoint=False)
    edge = np.searchsorted(np.cumsum(length), at, side="right")
    share = ((at - (np.cumsum(length) - length)[edge]) / length[edge])[:, None]
    return np.asarray(corners_m[edge] * (1.0 - share) + ends[edge] * share)
