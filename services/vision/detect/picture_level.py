"""A cut-out of one picture at one level of its pyramid, and its gradients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array

Floats = NDArray[np.float32]
SMOOTH_PX = 1.0
MIN_NOISE_GREY = 0.1
# noise = the mean absolute second difference of an empty area; a low quantile over the picture leaves texture out
QUANTILE = 0.4
QUANTILE_OF_NORMAL = 0.5244


@dataclass(frozen=True, slots=True)
class Window:
    """A part of a picture, px: first column and row, and size; it may reach beyond the border."""

    left: int
    top: int
    width: int
    height: int

    @classmethod
    def around(cls, points_px: Array, margin_px: float, factor: int) -> Window:
        """The window that holds points (..., 2) with a margin; its sides are multiples of `factor`."""
        flat = points_px.reshape(-1, 2)
        low = np.floor(flat.min(axis=0) - margin_px).astype(int)
        size = np.ceil(flat.max(axis=0) + margin_px).astype(int) - low + 1
        size = -(-size // factor) * factor
        return cls(int(low[0]), int(low[1]), int(size[0]), int(size[1]))

    def cut(self, image: Floats) -> tuple[Floats, NDArray[np.bool_] | None]:
        """The pixels of the window (beyond the border: the border's), and a mask of those in the picture, None if all
        are."""
        height, width = image.shape
        right, bottom = self.left + self.width, self.top + self.height
        if self.left >= 0 and self.top >= 0 and right <= width and bottom <= height:
            return image[self.top : bottom, self.left : right], None
        rows, columns = np.arange(self.top, bottom), np.arange(self.left, right)
        seen = ((rows >= 0) & (rows < height))[:, None] & ((columns >= 0) & (columns < width))
        return image[np.clip(rows, 0, height - 1)[:, None], np.clip(columns, 0, width - 1)], seen


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """A window of a picture: `grey` (height, width); its smoothed gradients (height, width, 2), x and y, grey per pixel
    of this level, 0 beyond the picture; and the noise of both, one sd. A level pixel covers `factor` by `factor` pixels
    of the picture, which is `size_px` (width, height)."""

    grey: Floats
    gradient: Floats
    grey_noise: float
    noise: float
    factor: int
    window: Window
    size_px: tuple[int, int]

    @classmethod
    def of(cls, image: Floats, window: Window, factor: int) -> Level:
        """The window of a picture, averaged over blocks of `factor` pixels, smoothed and differentiated."""
        cut, seen = window.cut(image)
        cut = np.ascontiguousarray(cut)
        size = (window.width // factor, window.height // factor)
        small = np.asarray(cv2.resize(cut, size, interpolation=cv2.INTER_AREA) if factor > 1 else cut, np.float32)
        mask = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
        bend = np.abs(cv2.filter2D(small, -1, mask))
        noise = float(np.quantile(bend[1:-1:2, 1:-1:2], QUANTILE)) / QUANTILE_OF_NORMAL / 6.0
        smooth = cv2.GaussianBlur(small, (0, 0), SMOOTH_PX, borderType=cv2.BORDER_REPLICATE)
        gradient = np.dstack([cv2.Sobel(smooth, cv2.CV_32F, *order, scale=0.125) for order in ((1, 0), (0, 1))])
        if seen is not None:
            inside = cv2.erode(seen.astype(np.uint8), np.ones((2 * factor + 1,) * 2, np.uint8), borderValue=1)
            kept = cv2.resize(inside, size, interpolation=cv2.INTER_NEAREST)
            gradient = gradient * np.asarray(kept, dtype=np.float32)[..., None]
        noise = max(noise, MIN_NOISE_GREY)
        return cls(
            small,
            gradient.astype(np.float32),
            noise,
            noise * _noise_gain(),
            factor,
            window,
            (image.shape[1], image.shape[0]),
        )

    def to_level(self, points_px: Array) -> Array:
        """Places in this level of pixels (..., 2) of the picture; integers are pixel centres in both."""
        corner = np.array([self.window.left, self.window.top])
        return np.asarray((points_px - corner + 0.5) / self.factor - 0.5)

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Whether points (..., 2) of the level lie in the picture."""
        low, high = self.to_level(np.zeros(2)), self.to_level(np.array(self.size_px) - 1.0)
        return np.asarray(np.all((points >= low) & (points <= high), axis=-1))


@cache
def _noise_gain() -> float:
    """The gradient's noise for a pixel noise of 1."""
    spike = np.zeros((33, 33), dtype=np.float32)
    spike[16, 16] = 1.0
    smooth = cv2.GaussianBlur(spike, (0, 0), SMOOTH_PX)
    return float(np.linalg.norm(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125)))
