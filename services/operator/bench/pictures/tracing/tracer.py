"""Path-traced pictures, linear and without a sensor: fine about the hole, less so on the plate, coarse around it.

Everything is drawn by pinholes with square pixels, about the camera's own axis; `sensor` makes pictures of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.operator.bench.pictures.tracing.renderer import mitsuba

MAX_BOUNCES = 6
CLOSE_M = 5e-4
MIN_WINDOW, WINDOW_STEP = 224, 32
FloatImage = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class LightLevel:
    """A part of a picture: pixel (row j, column i) averages x' from (left + i) / focal to (left + i + 1) / focal, y' so
    from `top`; x' = x / z, y' = y / z in the camera's frame. `light` (rows, columns) is linear.
    """

    focal_px: float
    left: int
    top: int
    light: FloatImage


@dataclass(frozen=True, slots=True)
class TraceWindow:
    """Where to draw: see `Level`; samples a pixel."""

    focal_px: float
    left: int
    top: int
    width: int
    height: int
    samples: int


def window_around(xy: Array, focal_px: float, margin_px: float, samples: int) -> TraceWindow:
    """The square window that holds normalised image places (n, 2), with a margin in its own pixels.

    A vectorised variant compiles a program for each size and number of samples: there are few sizes.
    """
    low = np.floor(xy.min(axis=0) * focal_px - margin_px).astype(int)
    high = np.ceil(xy.max(axis=0) * focal_px + margin_px).astype(int)
    side = max(MIN_WINDOW, -(-int(np.max(high - low)) // WINDOW_STEP) * WINDOW_STEP)
    left, top = low - (side - (high - low)) // 2
    return TraceWindow(focal_px, int(left), int(top), side, side, samples)


class Tracer:
    """A scene, loaded: the parts by name as Mitsuba's dictionaries, in the left camera's frame."""

    def __init__(self, parts: dict[str, Any]) -> None:
        self._mi = mitsuba()
        integrator = {"type": "path", "max_depth": MAX_BOUNCES, "rr_depth": 32, "hide_emitters": False}
        self._scene = self._mi.load_dict({"type": "scene", "integrator": integrator, **parts})

    def draw(self, pose_world_camera: Pose, window: TraceWindow, seed: int) -> LightLevel:
        """One window of one camera's picture."""
        mi = self._mi
        # the renderer's camera has x to the left and y up; the film is as large as the window, with the axis beside it:
        # windows of one size are one kernel to a vectorised variant
        matrix = pose_world_camera.matrix() @ np.diag([-1.0, -1.0, 1.0, 1.0])
        sensor = mi.load_dict(
            {
                "type": "perspective", "fov_axis": "x", "near_clip": 1e-3, "far_clip": 100.0,
                "fov": float(np.degrees(2.0 * np.arctan(0.5 * window.width / window.focal_px))),
                "principal_point_offset_x": window.left / window.width + 0.5,
                "principal_point_offset_y": window.top / window.height + 0.5,
                "to_world": mi.ScalarTransform4f(matrix.tolist()),
                "film": {
                    "type": "hdrfilm", "width": window.width, "height": window.height, "pixel_format": "luminance",
                    "component_format": "float32", "rfilter": {"type": "box"},
                },
                "sampler": {"type": "multijitter", "sample_count": window.samples},
            }
        )  # fmt: skip
        drawn = np.array(mi.render(self._scene, sensor=sensor, seed=seed), dtype=np.float32)
        return LightLevel(window.focal_px, window.left, window.top, drawn.reshape(window.height, window.width))

    def hidden(self, eye_m: Array, points_m: Array) -> NDArray[np.bool_]:
        """(n,): which points (n, 3) something stands in front of, seen from an eye (3,)."""
        mi = self._mi
        rays = points_m - eye_m
        lengths = np.linalg.norm(rays, axis=1)
        ways = rays / lengths[:, None]
        if not mi.variant().startswith("scalar"):
            # a vectorised variant takes them all at once
            ray = mi.Ray3f(mi.Point3f(*map(float, eye_m)), mi.Vector3f(ways.T.astype(np.float32)))
            hits = self._scene.ray_intersect(ray)
            return np.asarray(np.array(hits.t) < lengths - CLOSE_M)
        blocked = []
        for way, length in zip(ways, lengths, strict=True):
            hit = self._scene.ray_intersect(mi.Ray3f(list(map(float, eye_m)), list(map(float, way))))
            blocked.append(hit.is_valid() and hit.t < length - CLOSE_M)
        return np.array(blocked, dtype=bool)


def draw_levels(tracer: Tracer, pose_world_camera: Pose, windows: Sequence[TraceWindow], seed: int) -> list[LightLevel]:
    """The windows of one camera, each with a seed of its own."""
    return [tracer.draw(pose_world_camera, window, seed + index) for index, window in enumerate(windows)]
