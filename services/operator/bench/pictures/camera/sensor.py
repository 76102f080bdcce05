"""From clean light to a camera's picture: lens, blur, exposure, shot and read noise, gamma, bits; all by a seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from crosspih_common.geometry.pose import Array
from services.operator.bench.pictures.camera.cameras import PictureLens
from services.operator.bench.pictures.tracing.tracer import FloatImage, LightLevel

GRID_STEP = 8
MAX_SUBPIXELS = 3


@dataclass(frozen=True, slots=True)
class Sensor:
    """How light becomes grey. `blur_px`: Gaussian, before the pixel's own square; `motion_px`: length of a drag.

    `noise_grey`: read noise, of 255; `full_well_e`: electrons at full scale, whose shot noise is added; None for none.
    `gamma`: linear or srgb; `bits`: 8, or 10 to 16, which are stored as 16 with the low bits empty. `vignetting`: how
    much darker the picture's corner is. `exposure`: a factor on the scene's own.
    """

    blur_px: float = 0.7
    noise_grey: float = 3.0
    motion_px: float = 0.0
    full_well_e: float | None = None
    gamma: str = "linear"
    bits: int = 8
    vignetting: float = 0.0
    exposure: float = 1.0


def expose(
    levels: Sequence[LightLevel], lens: PictureLens, sensor: Sensor, rng: np.random.Generator
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The picture (height, width) of one camera; `levels` from coarse to fine, their light as a share of full scale."""
    light = sensor.exposure * seen(levels, lens, sensor, float(rng.uniform(0.0, np.pi)))
    if sensor.vignetting:
        v, u = np.mgrid[0 : lens.height_px, 0 : lens.width_px].astype(np.float32)
        far = ((u - lens.cx_px) / lens.width_px) ** 2 + ((v - lens.cy_px) / lens.height_px) ** 2
        light *= 1.0 - sensor.vignetting * far / 0.5
    if sensor.full_well_e is not None:
        shot = rng.standard_normal(light.shape, dtype=np.float32)
        light = light + shot * np.sqrt(np.maximum(light, 0.0) / sensor.full_well_e)
    light = light + rng.standard_normal(light.shape, dtype=np.float32) * (sensor.noise_grey / 255.0)
    share = np.clip(light, 0.0, 1.0)
    if sensor.gamma == "srgb":
        share = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1.0 / 2.4) - 0.055)
    if sensor.bits == 8:
        return np.asarray(np.rint(share * 255.0), dtype=np.uint8)
    steps = 2**sensor.bits - 1
    return np.asarray(np.rint(share * steps) * (65536 // (steps + 1)), dtype=np.uint16)


def seen(levels: Sequence[LightLevel], lens: PictureLens, sensor: Sensor, motion_rad: float = 0.0) -> FloatImage:
    """The clean, blurred light (height, width) on the sensor, a share of full scale."""
    finest = max(level.focal_px for level in levels)
    # where a lens squeezes the picture, places between sub-pixels must not be passed over
    squeezed = 1.4 if lens.distortion_model != "none" else 1.0
    count = int(np.clip(round(squeezed * finest / lens.fx_px), 1, MAX_SUBPIXELS))
    xy = _rays(lens, count)
    picture: FloatImage | None = None
    for level in levels:
        columns = (xy[0] * level.focal_px - level.left - 0.5).astype(np.float32)
        rows = (xy[1] * level.focal_px - level.top - 0.5).astype(np.float32)
        if picture is None:
            picture = np.asarray(
                cv2.remap(level.light, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32
            )
            continue
        high, wide = level.light.shape
        inside = (columns >= 0.5) & (rows >= 0.5) & (columns <= wide - 1.5) & (rows <= high - 1.5)
        lines, places = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
        if not len(lines):
            continue
        part = np.s_[lines[0] : lines[-1] + 1, places[0] : places[-1] + 1]
        drawn = cv2.remap(level.light, columns[part], rows[part], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        picture[part] = np.where(inside[part], drawn, picture[part])
    assert picture is not None
    blur = sensor.blur_px * count
    if blur > 0.0:
        side = 2 * int(np.ceil(4.0 * blur)) + 1
        picture = np.asarray(cv2.GaussianBlur(picture, (side, side), blur, borderType=cv2.BORDER_REPLICATE), np.float32)
    if sensor.motion_px:
        kernel = _drag(sensor.motion_px * count, motion_rad)
        picture = np.asarray(cv2.filter2D(picture, -1, kernel, borderType=cv2.BORDER_REPLICATE), np.float32)
    if count > 1:
        blocks = picture.reshape(lens.height_px, count, lens.width_px, count)
        picture = np.asarray(blocks.mean(axis=(1, 3)), dtype=np.float32)
    return picture


def _rays(lens: PictureLens, count: int) -> tuple[Any, Any]:
    """(x', y') of a pinhole, each (rows, columns), for `count` x `count` sub-pixels a pixel."""
    u = (np.arange(lens.width_px * count) + 0.5) / count - 0.5
    v = (np.arange(lens.height_px * count) + 0.5) / count - 0.5
    x, y = (u - lens.cx_px) / lens.fx_px, (v - lens.cy_px) / lens.fy_px
    if lens.distortion_model == "none":
        return np.meshgrid(x, y)
    # the inverse of the distortion on a coarse grid, and splines between: smooth to far below a thousandth of a pixel
    nodes_x = np.linspace(x[0], x[-1], len(x) // GRID_STEP)
    nodes_y = np.linspace(y[0], y[-1], len(y) // GRID_STEP)
    straight = lens.undistorted(np.stack(np.meshgrid(nodes_x, nodes_y), axis=-1))
    bent_x, bent_y = (RectBivariateSpline(nodes_y, nodes_x, straight[..., axis])(y, x) for axis in range(2))
    return bent_x, bent_y


def _drag(length_px: float, turn_rad: float) -> Array:
    """A kernel that drags a picture along a line, its mass central."""
    half = int(np.ceil(length_px / 2.0)) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1))
    for step in np.linspace(-0.5, 0.5, 16 * half + 1) * length_px:
        x, y = half + step * np.cos(turn_rad), half + step * np.sin(turn_rad)
        i, j = int(np.floor(x)), int(np.floor(y))
        fx, fy = x - i, y - j
        kernel[j, i] += (1 - fx) * (1 - fy)
        kernel[j, i + 1] += fx * (1 - fy)
        kernel[j + 1, i] += (1 - fx) * fy
        kernel[j + 1, i + 1] += fx * fy
    return np.asarray(kernel / kernel.sum())
