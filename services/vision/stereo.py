"""What the two cameras are, as the core sees them: pinhole projection into both images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class StereoModel:
    """Two equal parallel pinhole cameras: u = fx x/z + cx, v = fy y/z + cy, integers at pixel centres.

    The second stands `baseline_m` along the first's +x; `pose_base_camera` is the first's, z forward, x right, y down.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    baseline_m: float
    pose_base_camera: Pose

    def project(self, points_camera_m: Array) -> Array:
        """Pixels (2, ..., 2), left then right, of points (..., 3) in the left camera's frame."""
        x, y, z = (points_camera_m[..., axis] for axis in range(3))
        v = self.fy_px * y / z + self.cy_px
        left = np.stack([self.fx_px * x / z + self.cx_px, v], axis=-1)
        right = np.stack([self.fx_px * (x - self.baseline_m) / z + self.cx_px, v], axis=-1)
        return np.stack([left, right])

    def triangulate(self, left_px: Array, right_px: Array) -> Array:
        """Points (..., 3), m, left camera, of pixels (..., 2) in both images (the paper's Eq. 4, y by the mean row)."""
        z = self.fx_px * self.baseline_m / (left_px[..., 0] - right_px[..., 0])
        row = 0.5 * (left_px[..., 1] + right_px[..., 1])
        return np.stack([(left_px[..., 0] - self.cx_px) * z / self.fx_px, (row - self.cy_px) * z / self.fy_px, z], -1)
