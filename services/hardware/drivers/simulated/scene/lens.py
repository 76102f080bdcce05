"""The bend of a lens: OpenCV's plumb_bob, exact for points, and for whole pictures as a map from pixel to pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

FloatImage = NDArray[np.float32]

NUMBERS = 8
UNBEND_STEPS, UNBENT, STEP = 20, 1e-12, 1e-6
BORDER_PX, NODE_PX = 1, 4


@dataclass(frozen=True, slots=True)
class ImageWindow:
    """A part of an image: columns left..right - 1, rows top..bottom - 1; of a pinhole's, also outside the sensor."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def empty(self) -> bool:
        """Whether it holds no pixel."""
        return self.right <= self.left or self.bottom <= self.top

    def within(self, other: ImageWindow) -> ImageWindow:
        """What both hold."""
        return ImageWindow(
            max(self.left, other.left), max(self.top, other.top),
            min(self.right, other.right), min(self.bottom, other.bottom),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """One camera, z ahead, x right, y down: u = fx x' + cx, v = fy y' + cy, integers at pixel centres, (x', y') the
    slopes (x/z, y/z) bent by `distortion`, k1, k2, p1, p2, k3, k4, k5, k6; those left out are 0, all: a pinhole."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    @property
    def bends(self) -> bool:
        """Whether it is no pinhole."""
        return any(self.distortion)

    def bent(self, slopes: Array) -> Array:
        """Where slopes (..., 2) go (OpenCV 4, calib3d, "Detailed Description")."""
        if not self.bends:
            return slopes
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.distortion, *(0.0,) * (NUMBERS - len(self.distortion)))
        x, y = slopes[..., 0], slopes[..., 1]
        r2 = x * x + y * y
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        across = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        down = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        return np.stack([across, down], axis=-1)

    def pinhole(self, points_camera_m: Array) -> Array:
        """Pixels (..., 2) of points (..., 3) in the camera's frame, m, were the lens a pinhole."""
        points = np.asarray(points_camera_m, float)
        return self._pixels(points[..., :2] / points[..., 2:])

    def project(self, points_camera_m: Array) -> Array:
        """Pixels (..., 2) of points (..., 3) in the camera's frame, m, before it (z > 0)."""
        points = np.asarray(points_camera_m, float)
        return self._pixels(self.bent(points[..., :2] / points[..., 2:]))

    def _pixels(self, slopes: Array) -> Array:
        return np.stack([self.fx * slopes[..., 0] + self.cx, self.fy * slopes[..., 1] + self.cy], axis=-1)

    def straight(self) -> Array:
        """Where a pinhole has what each pixel sees, px: (height + 2, width + 2, 2), a border of one pixel around.

        Found at every few pixels, and cubic between them: to some 1e-5 px.
        """
        columns = np.arange(-BORDER_PX, self.width + BORDER_PX, dtype=float)
        rows = np.arange(-BORDER_PX, self.height + BORDER_PX, dtype=float)
        if not self.bends:
            return np.stack(np.meshgrid(columns, rows), axis=-1)
        across = np.linspace(columns[0], columns[-1], max(8, len(columns) // NODE_PX))
        down = np.linspace(rows[0], rows[-1], max(8, len(rows) // NODE_PX))
        nodes = self._pixels(self._unbent(np.stack(np.meshgrid(across, down), axis=-1)))
        return np.stack(
            [RectBivariateSpline(down, across, nodes[..., axis])(rows, columns) for axis in range(2)], axis=-1
        )

    def _unbent(self, pixels: Array) -> Array:
        """The slopes (..., 2) that are bent into pixels (..., 2), by Newton's method."""
        wanted = np.stack([(pixels[..., 0] - self.cx) / self.fx, (pixels[..., 1] - self.cy) / self.fy], axis=-1)
        found, aside, below = wanted, np.array([STEP, 0.0]), np.array([0.0, STEP])
        for _ in range(UNBEND_STEPS):
            off = self.bent(found) - wanted
            if float(np.abs(off).max()) < UNBENT:
                break
            by_x = (self.bent(found + aside) - self.bent(found - aside)) / (2.0 * STEP)
            by_y = (self.bent(found + below) - self.bent(found - below)) / (2.0 * STEP)
            determinant = by_x[..., 0] * by_y[..., 1] - by_y[..., 0] * by_x[..., 1]
            step_x = (by_y[..., 1] * off[..., 0] - by_y[..., 0] * off[..., 1]) / determinant
            step_y = (by_x[..., 0] * off[..., 1] - by_x[..., 1] * off[..., 0]) / determinant
            found = found - np.stack([step_x, step_y], axis=-1)
        return found


class Bend:
    """A lens's picture made from a pinhole's, in the same place, of the same focal length."""

    def __init__(self, lens: Lens) -> None:
        self._bends = lens.bends
        self.sees = ImageWindow(0, 0, lens.width, lens.height)
        """The part of the pinhole's picture that the lens brings onto the sensor."""
        if not lens.bends:
            return
        straight = lens.straight()
        self._straight = np.ascontiguousarray(straight, dtype=np.float32)
        low = np.floor(straight.reshape(-1, 2).min(axis=0)).astype(int)
        high = np.ceil(straight.reshape(-1, 2).max(axis=0)).astype(int)
        self.sees = ImageWindow(int(low[0]), int(low[1]), int(high[0]) + 1, int(high[1]) + 1)

    def put(self, drawn: FloatImage, window: ImageWindow, fine: int, onto: FloatImage) -> None:
        """Bend a window of the pinhole's picture, `drawn` with `fine` x `fine` sub-pixels a pixel, onto the sensor."""
        if not self._bends:
            onto[window.top : window.bottom, window.left : window.right] = averaged(drawn, fine)
            return
        inside = self._straight[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]
        held = (inside[..., 0] >= window.left) & (inside[..., 0] <= window.right - 1)
        held &= (inside[..., 1] >= window.top) & (inside[..., 1] <= window.bottom - 1)
        rows, columns = np.flatnonzero(held.any(axis=1)), np.flatnonzero(held.any(axis=0))
        if not len(rows):
            return
        top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
        # between pixels the bend is as good as straight: some 1e-4 px
        around = self._straight[top : bottom + 2 * BORDER_PX, left : right + 2 * BORDER_PX]
        size = (around.shape[1] * fine, around.shape[0] * fine)
        at = cv2.resize(around, size, interpolation=cv2.INTER_LINEAR)
        at = at[fine * BORDER_PX : -fine * BORDER_PX, fine * BORDER_PX : -fine * BORDER_PX]
        at = (at + np.float32(0.5) - np.array([window.left, window.top], np.float32)) * np.float32(fine)
        at -= np.float32(0.5)
        across, down = np.ascontiguousarray(at[..., 0]), np.ascontiguousarray(at[..., 1])
        bent = cv2.remap(drawn, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        part = np.s_[top:bottom, left:right]
        onto[part] = np.where(held[part], averaged(np.asarray(bent, np.float32), fine), onto[part])


def averaged(picture: FloatImage, side: int) -> FloatImage:
    """The means of blocks of `side` x `side` pixels."""
    if side == 1:
        return picture
    size = picture.shape[1] // side, picture.shape[0] // side
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def plane_to_samples(lens: Lens, pose_camera_plane: Pose, window: ImageWindow, samples: int) -> Array:
    """The homography (3, 3) from (x, y, 1) on a plane, m, to sub-pixels of a window of a pinhole's picture, `samples` a
    pixel and side; whole numbers at sub-pixel centres."""
    to_camera = np.column_stack([pose_camera_plane.rotation[:, :2], pose_camera_plane.translation_m])
    to_samples = np.array(
        [
            [samples * lens.fx, 0.0, samples * (lens.cx + 0.5 - window.left) - 0.5],
            [0.0, samples * lens.fy, samples * (lens.cy + 0.5 - window.top) - 0.5],
            [0.0, 0.0, 1.0],
        ]
    )
    return np.asarray(to_samples @ to_camera)
