"""The model of the two cameras: projection through each lens, and triangulation from both pictures.

Everything is exact in the pictures as they were taken: no picture is undistorted, rectified or resampled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, CameraModel, DistortionModel, Gamma

UNBEND_STEPS, REFINE_STEPS = 20, 4
UNBENT = 1e-13
UNBENT_PX = 1e-6  # largest distance between a ray's pixel and the given one


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """One camera, z forward, x right, y down: u = fx x'/z + cx, v = fy y'/z + cy, integers at pixel centres; (x', y')
    is bent by the lens: `distortion` (8,) k1, k2, p1, p2, k3, k4, k5, k6 (plumb_bob), or (4,) k1 to k4 (fisheye).
    `gamma` relates its numbers to the light."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion_model: DistortionModel
    distortion: Array
    gamma: Gamma

    @classmethod
    def of(cls, told: CameraModel) -> Camera:
        """From the message."""
        wanted = {DistortionModel.NONE: 0, DistortionModel.PLUMB_BOB: 8, DistortionModel.FISHEYE: 4}
        bent = any(told.distortion) or told.distortion_model is DistortionModel.FISHEYE
        model = told.distortion_model if bent else DistortionModel.NONE
        numbers = np.zeros(wanted[model])
        given = told.distortion[: len(numbers)]
        numbers[: len(given)] = given
        return cls(
            told.width_px, told.height_px, told.fx_px, told.fy_px, told.cx_px, told.cy_px, model, numbers, told.gamma
        )

    def more_bent(self, k1: float) -> Camera:
        """The camera with `k1` added to its lens's k1."""
        none = self.distortion_model is DistortionModel.NONE
        distortion = np.zeros(8) if none else self.distortion.copy()
        distortion[0] += k1
        model = DistortionModel.PLUMB_BOB if none else self.distortion_model
        return replace(self, distortion_model=model, distortion=distortion)

    def bent(self, slopes: Array) -> Array:
        """The slopes (x/z, y/z) (..., 2) after distortion, as in cv2.projectPoints and cv2.fisheye.projectPoints."""
        if self.distortion_model is DistortionModel.NONE:
            return slopes
        x, y = slopes[..., 0], slopes[..., 1]
        r2 = x * x + y * y
        if self.distortion_model is DistortionModel.FISHEYE:
            r = np.sqrt(r2)
            angle = np.arctan(r)
            ratio = np.where(r > 1e-9, self._fish(angle) / np.maximum(r, 1e-9), 1.0)
            return slopes * ratio[..., None]
        k1, k2, p1, p2, k3, k4, k5, k6 = self.distortion
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        across = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        down = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        return np.stack([across, down], axis=-1)

    def _fish(self, angle: Array) -> Array:
        a2 = angle * angle
        k1, k2, k3, k4 = self.distortion
        return np.asarray(angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)))))

    def project(self, points_camera_m: Array) -> Array:
        """Pixels (..., 2) of points (..., 3) in this camera's frame, m, in front of it (z > 0)."""
        slopes = self.bent(points_camera_m[..., :2] / points_camera_m[..., 2:])
        return np.asarray(slopes * (self.fx_px, self.fy_px) + (self.cx_px, self.cy_px))

    def slopes(self, pixels: Array) -> Array:
        """Slopes (x/z, y/z) (..., 2) of the rays of pixels (..., 2); NaN for a pixel that the lens's formula never
        reaches (a barrel distortion bends back beyond some angle)."""
        pixels = np.asarray(pixels, dtype=float)
        seen = np.stack(
            [(pixels[..., 0] - self.cx_px) / self.fx_px, (pixels[..., 1] - self.cy_px) / self.fy_px], axis=-1
        )
        if self.distortion_model is DistortionModel.NONE:
            return seen
        with np.errstate(all="ignore"):
            found = self._unfished(seen) if self.distortion_model is DistortionModel.FISHEYE else self._unbent(seen)
            off = np.abs(self.bent(found) - seen).max(axis=-1, keepdims=True)
            return np.where(off < UNBENT_PX / min(self.fx_px, self.fy_px), found, np.nan)

    def _unfished(self, seen: Array) -> Array:
        bent = np.linalg.norm(seen, axis=-1, keepdims=True)
        angle = np.minimum(bent, 1.5)
        for _ in range(UNBEND_STEPS):
            slope = (self._fish(angle + 1e-6) - self._fish(angle - 1e-6)) / 2e-6
            angle = np.clip(angle - (self._fish(angle) - bent) / slope, 0.0, 1.57)
        return np.asarray(seen * np.where(bent > 1e-9, np.tan(angle) / np.maximum(bent, 1e-9), 1.0))

    def _unbent(self, seen: Array) -> Array:
        found, delta = seen, 1e-6
        aside, below = np.array([delta, 0.0]), np.array([0.0, delta])
        for _ in range(UNBEND_STEPS):
            off = self.bent(found) - seen
            by_x = (self.bent(found + aside) - self.bent(found - aside)) / (2.0 * delta)
            by_y = (self.bent(found + below) - self.bent(found - below)) / (2.0 * delta)
            determinant = by_x[..., 0] * by_y[..., 1] - by_y[..., 0] * by_x[..., 1]
            step_x = (by_y[..., 1] * off[..., 0] - by_y[..., 0] * off[..., 1]) / determinant
            step_y = (by_x[..., 0] * off[..., 1] - by_x[..., 1] * off[..., 0]) / determinant
            step = np.stack([step_x, step_y], axis=-1)
            found = found - step
            if np.all(np.abs(step) < UNBENT):
                break
        return found


@dataclass(frozen=True, slots=True, eq=False)
class StereoModel:
    """Two cameras, equal and parallel or not: `pose_left_right` is the right camera in the left one's frame,
    `pose_base_camera` the left one in the base."""

    left: Camera
    right: Camera
    pose_left_right: Pose
    pose_base_camera: Pose

    @classmethod
    def of(cls, calibration: CameraCalibration, correction: Pose | None = None) -> StereoModel:
        """From the message; `correction` is the true pose of the left camera in the frame that the message states."""
        pose_base_camera = calibration.pose_base_camera.pose()
        return cls(
            Camera.of(calibration.left),
            Camera.of(calibration.right),
            calibration.pose_left_right.pose(),
            pose_base_camera if correction is None else pose_base_camera @ correction,
        )

    @classmethod
    def parallel(
        cls, width_px: int, height_px: int, fx_px: float, fy_px: float, cx_px: float, cy_px: float, baseline_m: float,
        pose_base_camera: Pose,
    ) -> StereoModel:  # fmt: skip
        """Two equal parallel pinholes; the right one stands `baseline_m` along the left one's +x."""
        camera = Camera(
            width_px, height_px, fx_px, fy_px, cx_px, cy_px, DistortionModel.NONE, np.zeros(0), Gamma.LINEAR
        )
        return cls(camera, camera, Pose.from_translation([baseline_m, 0.0, 0.0]), pose_base_camera)

    def more_bent(self, k1: Array) -> StereoModel:
        """The model with `k1` (2,) added to the k1 of the left and the right lens."""
        left, right = (camera.more_bent(float(more)) for camera, more in zip(self.cameras, k1, strict=True))
        return replace(self, left=left, right=right)

    @property
    def cameras(self) -> tuple[Camera, Camera]:
        """Left, right."""
        return self.left, self.right

    @property
    def sizes_px(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """(width, height) of the left picture and of the right one."""
        return (self.left.width_px, self.left.height_px), (self.right.width_px, self.right.height_px)

    def project(self, points_camera_m: Array) -> Array:
        """Pixels (2, ..., 2), left then right, of points (..., 3) in the left camera's frame, m."""
        points = np.asarray(points_camera_m, dtype=float)
        rows = points.reshape(-1, 3)
        # points as rows: R^T (p - t)
        in_right = (rows - self.pose_left_right.translation_m) @ self.pose_left_right.rotation
        seen = np.stack([self.left.project(rows), self.right.project(in_right)])
        return seen.reshape(2, *points.shape[:-1], 2)

    def triangulate(self, left_px: Array, right_px: Array) -> Array:
        """Points (..., 3), m, left camera's frame, nearest in both pictures to pixels (..., 2) of each.

        Least squares of the distances in the two pictures (px, after undistortion); for equal parallel cameras
        that is the paper's Eq. 4 with y by the mean row. A point behind the cameras (z < 0) means that the pixels do
        not belong together or the pictures are swapped; parallel rays give infinity or NaN.
        """
        seen = np.stack([self.left.slopes(left_px), self.right.slopes(right_px)])
        focal = np.array([[camera.fx_px, camera.fy_px] for camera in self.cameras])
        rotation, origin = self.pose_left_right.rotation, self.pose_left_right.translation_m
        with np.errstate(all="ignore"):
            point = self._between_rays(seen)
            for _ in range(REFINE_STEPS):
                normal, gradient = np.zeros((*point.shape[:-1], 3, 3)), np.zeros(point.shape)
                for side, (turn, start) in enumerate(((np.eye(3), np.zeros(3)), (rotation, origin))):
                    local = (point - start) @ turn
                    x, y, z = (local[..., axis] for axis in range(3))
                    nothing = np.zeros_like(z)
                    rows = np.stack(
                        [np.stack([1.0 / z, nothing, -x / z**2], -1), np.stack([nothing, 1.0 / z, -y / z**2], -1)], -2
                    )
                    rows = (rows * focal[side][:, None]) @ turn.T
                    off = (seen[side] - local[..., :2] / z[..., None]) * focal[side]
                    normal += np.swapaxes(rows, -1, -2) @ rows
                    gradient += np.einsum("...ki,...k->...i", rows, off)
                sound = np.isfinite(normal).all(axis=(-1, -2)) & (np.abs(np.linalg.det(normal)) > 0.0)
                step = np.linalg.solve(np.where(sound[..., None, None], normal, np.eye(3)), gradient[..., None])[..., 0]
                point = np.where(sound[..., None], point + step, point)
        return point

    def _between_rays(self, slopes: Array) -> Array:
        """The midpoint of the shortest line between the two rays, slopes (2, ..., 2)."""
        ones = np.ones((*slopes.shape[:-1], 1))
        ahead = np.concatenate([slopes, ones], axis=-1)
        one, other = ahead[0], ahead[1] @ self.pose_left_right.rotation.T
        origin = self.pose_left_right.translation_m
        aa, ab, bb = np.sum(one * one, -1), np.sum(one * other, -1), np.sum(other * other, -1)
        at_a, at_b = one @ origin, other @ origin
        determinant = aa * bb - ab * ab
        along_one = (bb * at_a - ab * at_b) / determinant
        along_other = (ab * at_a - aa * at_b) / determinant
        return np.asarray(0.5 * (along_one[..., None] * one + origin + along_other[..., None] * other))

    def apart_px(self, left_px: Array, right_px: Array) -> Array:
        """(..., 2), px: the distance between the pictures in excess of one point's; for equal parallel cameras the
        difference of the rows. NaN or a z below 0 in `triangulate` means that there is no such point."""
        seen = self.project(self.triangulate(left_px, right_px))
        return np.asarray((left_px - seen[0]) - (right_px - seen[1]))
