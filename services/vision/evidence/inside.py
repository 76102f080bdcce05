"""The depth of what is seen inside the rim: in the face's plane (a print), a little below it (a pocket), or deep.

Both cameras see a picture in the face's plane alike once the shift of that plane is removed; walls, a bottom or the
background look different. The depth of the plane is swept, starting at 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.fit.solve import Images
from services.vision.fit.steps import sample
from services.vision.light import Light
from services.vision.stereo import StereoModel

MAX_POINTS = 1600
SMOOTH_PX = 1.0  # one sd
NOISY_GREY = 1.4  # residual noise after smoothing; above it, noise is a relevant share of the signal
# distance kept from the inner rim, so that its step does not reach in: at the finer smoothing, and added per px of more
MARGIN_PX, MARGIN_PER_PX = 2.5, 1.5
MIN_POINTS = 60
MASK_M = 0.2e-3


@dataclass(frozen=True, slots=True, eq=False)
class Inside:
    """Parallax sweep over depths (D,), m: how much of the left picture's inside is not explained by the right one at
    each.

    structure: sd of the smoothed inside without the noise, grey; noise: remaining sd of the noise after smoothing,
    grey; unexplained (D,): residual sd without the noise, grey; bright: median grey inside.
    """

    depths_m: Array
    unexplained: Array
    structure: float
    noise: float
    points: int
    bright: float

    @property
    def noisy(self) -> bool:
        """Whether noise is a relevant share of the signal."""
        return self.noise > NOISY_GREY

    @property
    def uneven(self) -> float:
        """The unevenness of the inside with half the noise, as a share of its brightness."""
        return float(np.hypot(self.structure, 0.5 * self.noise)) / max(self.bright, 1e-9)


def _grid(inner_m: Array, pixel_m: float, margin_px: float) -> Array:
    """Points (N, 2) of the face's plane inside the outline (n, 2), at a distance from it, m."""
    low, high = inner_m.min(axis=0), inner_m.max(axis=0)
    step = max(pixel_m, float(np.sqrt(np.prod(high - low) / (2.0 * MAX_POINTS))))
    x, y = np.meshgrid(*(np.arange(low[axis] + step / 2, high[axis], step) for axis in range(2)))
    points = np.column_stack([x.ravel(), y.ravel()])
    mask = np.zeros(np.ceil((high - low) / MASK_M).astype(int)[::-1] + 4, np.uint8)
    cv2.fillPoly(mask, [np.rint((inner_m - low) / MASK_M).astype(np.int32) + 1], 1)
    far = cv2.distanceTransform(mask, cv2.DIST_L2, 5) * MASK_M
    at = np.rint((points - low) / MASK_M).astype(int) + 1
    return np.asarray(points[far[at[:, 1], at[:, 0]] > margin_px * pixel_m])


def seen_inside(images: Images, stereo: StereoModel, pose_camera_hole: Pose, inner_rim_m: Array, depths_m: Array,
                noise_variance: tuple[float, float], smooth_px: float = SMOOTH_PX) -> Inside:  # fmt: skip
    """`inner_rim_m` (n, 3) hole frame; `noise_variance` per pixel of the left and the right picture inside the rim,
    grey^2; `smooth_px`: sd of the smoothing of both pictures."""
    margin_px = MARGIN_PX + MARGIN_PER_PX * max(smooth_px - SMOOTH_PX, 0.0)
    centre = stereo.project(pose_camera_hole.apply(np.array([[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0]])))
    pixel_m = float(1e-3 / np.linalg.norm(centre[:, 1] - centre[:, 0], axis=-1).min())
    grid = _grid(inner_rim_m[:, :2], pixel_m, margin_px)
    if len(grid) < MIN_POINTS:
        return Inside(depths_m, np.zeros(len(depths_m)), 0.0, 0.0, len(grid), 0.0)
    on_face = pose_camera_hole.apply(np.column_stack([grid, np.zeros(len(grid))]))
    eye = on_face / np.linalg.norm(on_face, axis=1, keepdims=True)
    axis, origin = pose_camera_hole.rotation[:, 2], pose_camera_hole.translation_m
    places = [eye * ((origin @ axis + depth) / (eye @ axis))[:, None] for depth in depths_m]
    seen = stereo.project(np.stack([on_face, *places]))
    smooth = tuple(_smoothed(images[side], seen[side].reshape(-1, 2), smooth_px) for side in range(2))
    left = sample(smooth[0], seen[0, :1])[0]
    rights = sample(smooth[1], seen[1, 1:])
    # a Gaussian of sd s keeps 1 / (4 pi s^2) of white noise's variance
    kept = 1.0 / (4.0 * np.pi * smooth_px**2)
    noise_left, noise_right = (kept * value for value in noise_variance)
    noisy = noise_left + noise_right > NOISY_GREY**2
    flat = np.column_stack([np.ones(len(grid)), grid / np.abs(grid).max()])
    structure = left - flat @ np.linalg.lstsq(flat, left, rcond=None)[0]
    unexplained = []
    inner = _inside_again(stereo, pose_camera_hole, inner_rim_m, seen[1, 1:], margin_px)
    for right, counted in zip(rights, inner, strict=True):
        if counted.sum() < MIN_POINTS:
            unexplained.append(np.nan)
            continue
        terms = np.column_stack([flat[counted], right[counted]])
        explained = np.linalg.lstsq(terms, left[counted], rcond=None)[0]
        rest = left[counted] - terms @ explained
        # the right picture's noise enters as strongly as that picture explains the left one
        noise_here = noise_left + (explained[-1] ** 2 * noise_right if noisy else 0.0)
        unexplained.append(max(float(np.mean(rest**2)) - noise_here, 0.0))
    total = max(float(np.mean(structure**2)) - noise_left, 0.0)
    return Inside(
        depths_m,
        np.sqrt(unexplained),
        float(np.sqrt(total)),
        float(np.sqrt(noise_left + noise_right)),
        len(grid),
        float(np.median(left)),
    )


def _inside_again(stereo: StereoModel, pose: Pose, inner: Array, right_px: Array, margin_px: float) -> Array:
    """(D, N): whether the right camera sees each place through the rim too, at a distance from its line."""
    rim = stereo.project(pose.apply(inner))[1].astype(np.float32).reshape(-1, 1, 2)
    low = np.floor(rim.min(axis=0)[0]).astype(int) - 2
    size = np.ceil(rim.max(axis=0)[0]).astype(int) - low + 3
    mask = np.zeros((size[1], size[0]), np.uint8)
    cv2.fillPoly(mask, [np.rint(rim - low).astype(np.int32)], 1)
    far = cv2.distanceTransform(mask, cv2.DIST_L2, 3)
    at = np.rint(right_px - low).astype(int)
    ok = (at[..., 0] >= 0) & (at[..., 1] >= 0) & (at[..., 0] < size[0]) & (at[..., 1] < size[1])
    at = np.where(ok[..., None], at, 0)
    return np.asarray(ok & (far[at[..., 1], at[..., 0]] > margin_px))


def _smoothed(image: Light, points: Array, smooth_px: float) -> Light:
    height, width = image.shape
    low = np.clip(np.floor(points.min(axis=0)) - 8, 0, [width - 1, height - 1]).astype(int)
    high = np.clip(np.ceil(points.max(axis=0)) + 8, 1, [width, height]).astype(int)
    out = image.copy()
    part = (slice(low[1], high[1]), slice(low[0], high[0]))
    out[part] = cv2.GaussianBlur(out[part], (0, 0), smooth_px)
    return out
