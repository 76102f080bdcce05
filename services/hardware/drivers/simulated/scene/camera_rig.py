"""The stereo pair of the cell: where it stands, and its numbers as a renderer wants them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.config import CameraSection
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraModel, DistortionModel
from services.hardware.drivers.simulated.scene.lens import ImageWindow, Lens


@dataclass(frozen=True, slots=True, eq=False)
class StereoRig:
    """Two equal parallel cameras, each with a lens of its own; the second stands `baseline_m` along the first's +x.

    Pixel (u, v) = (fx x'/z + cx, fy y'/z + cy), with integers at pixel *centres*, u to the right and v down, and
    (x', y') bent by the lens; without `distortions` (of the left one, of the right one) both are pinholes.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    baseline_m: float
    pose_base_camera: Pose
    distortions: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())
    pose_left_right: Pose | None = None
    """Where the right camera stands when it is not parallel."""

    @classmethod
    def of(cls, camera: CameraSection) -> StereoRig:
        """The pair that a cell's file describes."""
        return cls(
            width=camera.width_px, height=camera.height_px, fx=camera.fx_px, fy=camera.fy_px, cx=camera.cx_px,
            cy=camera.cy_px, baseline_m=camera.baseline_m, pose_base_camera=camera.pose_base_camera(),
            distortions=camera.distortions(),
        )  # fmt: skip

    def poses_base(self) -> tuple[Pose, Pose]:
        """The left and the right camera in the base frame."""
        return self.pose_base_camera, self.pose_base_right()

    def pose_base_right(self) -> Pose:
        """The right camera in the base frame."""
        if self.pose_left_right is not None:
            return self.pose_base_camera @ self.pose_left_right
        return self.pose_base_camera @ Pose.from_translation([self.baseline_m, 0.0, 0.0])

    def lens(self, side: int) -> Lens:
        """That of the left camera (0) or of the right one (1)."""
        return Lens(self.width, self.height, self.fx, self.fy, self.cx, self.cy, self.distortions[side])

    def project(self, points_camera_m: Array, side: int = 0) -> Array:
        """Pixels (..., 2) of points (..., 3) in the frame of the left camera (`side` 0) or of the right one (1), m."""
        return self.lens(side).project(points_camera_m)

    def models(self) -> tuple[CameraModel, CameraModel]:
        """The left and the right camera as the calibration says them."""
        left, right = (
            CameraModel(
                width_px=self.width, height_px=self.height, fx_px=self.fx, fy_px=self.fy, cx_px=self.cx, cy_px=self.cy,
                distortion_model=DistortionModel.PLUMB_BOB if any(numbers) else DistortionModel.NONE,
                distortion=numbers if any(numbers) else (),
            )
            for numbers in self.distortions
        )  # fmt: skip
        return left, right


def window_around(
    lens: Lens, boxes_camera_m: list[Array], near_m: float, sees: ImageWindow, pad_px: int = 6
) -> ImageWindow:
    """The smallest window (padded) of a pinhole's picture, within what the lens sees, that holds the pictures of some
    boxes, each (8, 3) corners in the camera's frame, m.

    A box that reaches through the near plane makes it all that is seen; one behind it does not count.
    """
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for corners in boxes_camera_m:
        ahead = corners[:, 2] > near_m
        if not ahead.any():
            continue
        if not ahead.all():
            return sees
        pixels = lens.pinhole(corners)
        low, high = np.minimum(low, pixels.min(axis=0)), np.maximum(high, pixels.max(axis=0))
    if not np.isfinite(low).all():
        return ImageWindow(0, 0, 0, 0)
    left, top = np.floor(low).astype(int) - pad_px
    right, bottom = np.ceil(high).astype(int) + pad_px + 1
    return ImageWindow(int(left), int(top), int(right), int(bottom)).within(sees)


def view_matrix(pose_base_camera: Pose) -> list[float]:
    """The OpenGL view matrix, column-major, of a camera whose z looks ahead and y down."""
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    matrix = flip @ pose_base_camera.inverse().matrix()
    return [float(value) for value in matrix.T.ravel()]


def look_at_matrix(eye_m: tuple[float, float, float], target_m: tuple[float, float, float]) -> list[float]:
    """The OpenGL view matrix, column-major, of an eye that looks at a point with the base frame's z upwards."""
    ahead = np.subtract(target_m, eye_m) / np.linalg.norm(np.subtract(target_m, eye_m))
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rows = np.array([right, np.cross(right, ahead), -ahead])
    matrix = np.vstack([np.column_stack([rows, -rows @ np.asarray(eye_m)]), [0.0, 0.0, 0.0, 1.0]])
    return [float(value) for value in matrix.T.ravel()]


def lens_matrix(fov_deg: float, aspect: float, near_m: float, far_m: float) -> list[float]:
    """The OpenGL projection, column-major, of a lens with an upright field of view."""
    scale = 1.0 / np.tan(np.radians(fov_deg) / 2.0)
    matrix = np.diag([scale / aspect, scale, -(far_m + near_m) / (far_m - near_m), 0.0])
    matrix[2, 3], matrix[3, 2] = -2.0 * far_m * near_m / (far_m - near_m), -1.0
    return [float(value) for value in matrix.T.ravel()]


def projection_matrix(lens: Lens, window: ImageWindow, samples: int, near_m: float, far_m: float) -> list[float]:
    """The OpenGL projection, column-major, that draws one window of the image at `samples` sub-pixels a pixel.

    A renderer tests each sub-pixel (i, j) at its lower left corner (i, j + 1) instead of its centre (i + .5, j + .5),
    y down. The whole frustum is moved by that half sub-pixel, so that pixels mean what `Lens.pinhole` says.
    """
    columns, rows = (window.right - window.left) * samples, (window.bottom - window.top) * samples
    centre_x = (lens.cx + 0.5 - window.left) * samples - 0.5
    centre_y = (lens.cy + 0.5 - window.top) * samples + 0.5
    across, down = near_m / (lens.fx * samples), near_m / (lens.fy * samples)
    left, right = -centre_x * across, (columns - centre_x) * across
    top, bottom = centre_y * down, (centre_y - rows) * down
    matrix = np.array(
        [
            [2 * near_m / (right - left), 0.0, (right + left) / (right - left), 0.0],
            [0.0, 2 * near_m / (top - bottom), (top + bottom) / (top - bottom), 0.0],
            [0.0, 0.0, -(far_m + near_m) / (far_m - near_m), -2 * far_m * near_m / (far_m - near_m)],
            [0.0, 0.0, -1.0, 0.0],
        ]
    )
    return [float(value) for value in matrix.T.ravel()]
