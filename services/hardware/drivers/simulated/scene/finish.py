"""What tools leave on a plate's face: marks in the plate's own coordinates, so that both cameras see the same ones."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.config import Finish

Marks = NDArray[np.float32]

SIZE = 1024
MAX_SPREADS = 3.0


def texel_m(half_size_m: float) -> float:
    """How much of a plate one texel covers."""
    return 2.0 * half_size_m / SIZE


def texels(points_m: Array, half_size_m: float) -> Array:
    """(column, row) (..., 2) of points (..., 2) on the face, hole frame, m; whole numbers at texel centres."""
    return np.asarray((np.asarray(points_m, float) + half_size_m) / texel_m(half_size_m) - 0.5)


def places_m(half_size_m: float, size: int = SIZE) -> tuple[Array, Array]:
    """Where the centres of a face's parts are, so many a side: x and y (size, size), hole frame, m."""
    line = ((np.arange(size) + 0.5) * (2.0 / size) - 1.0) * half_size_m
    x, y = np.meshgrid(line, line)
    return x, y


def lay_rad(finish: Finish, x_m: Array, y_m: Array, seed: int) -> Array | None:
    """Which way the grooves run at points on the face, rad from x; None where a finish has none."""
    if finish in ("milled", "ground"):
        return np.full(np.shape(x_m), np.random.default_rng(seed).uniform(0.0, np.pi))
    if finish == "turned":
        middle = _turning_centre_m(np.random.default_rng(seed))
        return np.asarray(np.arctan2(y_m - middle[1], x_m - middle[0]) + np.pi / 2)
    return None


def marks(finish: Finish, half_size_m: float, seed: int) -> Marks:
    """(SIZE, SIZE): how much lighter or darker each texel is; mean 0, standard deviation 1, cut off at 3."""
    rng = np.random.default_rng(seed)
    if finish == "turned":
        made = _turned(half_size_m, rng)
    elif finish == "milled":
        made = _milled(half_size_m, rng)
    elif finish == "ground":
        made = _ground(half_size_m, rng)
    else:
        made = _speckled(finish, half_size_m, rng)
    made -= made.mean()
    made /= max(float(made.std()), 1e-12)
    return np.asarray(np.clip(made, -MAX_SPREADS, MAX_SPREADS), dtype=np.float32)


def _turning_centre_m(rng: np.random.Generator) -> Array:
    return np.asarray(rng.uniform(-0.005, 0.005, 2))


def _turned(half_size_m: float, rng: np.random.Generator) -> Marks:
    """Rings of a facing tool: as many as its feed leaves, each a little lighter or darker."""
    middle = _turning_centre_m(rng)
    x, y = places_m(half_size_m)
    return _feed_lines(np.hypot(x - middle[0], y - middle[1]), rng.uniform(0.4e-3, 1.2e-3), rng)


def _milled(half_size_m: float, rng: np.random.Generator) -> Marks:
    """Passes of an end mill side by side: each leaves arcs across its way, one a feed."""
    lay = rng.uniform(0.0, np.pi)
    x, y = places_m(half_size_m)
    # the grooves run along the lay, the mill goes across it
    across, along = x * np.cos(lay) + y * np.sin(lay), y * np.cos(lay) - x * np.sin(lay)
    radius_m = rng.uniform(0.012, 0.03)
    width_m = 1.2 * radius_m
    lane = np.rint(across / width_m)
    off = across - lane * width_m
    front = along - np.sqrt(radius_m**2 - off**2) * np.where(lane % 2 == 0, 1.0, -1.0)
    lines = _feed_lines(front, rng.uniform(0.6e-3, 1.8e-3), rng)
    # each pass by itself a shade lighter or darker
    shade = rng.standard_normal(256).astype(np.float32)
    return np.asarray(lines + np.float32(0.4) * shade[lane.astype(int) % 256], dtype=np.float32)


def _feed_lines(way_m: Array, feed_m: float, rng: np.random.Generator) -> Marks:
    """Grooves a feed apart along a way."""
    turn = (way_m / feed_m).astype(np.float32)
    strength = rng.standard_normal(4096).astype(np.float32)
    groove = strength[np.floor(turn).astype(int) % 4096]
    return np.asarray(np.cos(np.float32(2.0 * np.pi) * turn) + groove, dtype=np.float32)


def _ground(half_size_m: float, rng: np.random.Generator) -> Marks:
    """Fine scratches one way, each some centimetres long."""
    lay = rng.uniform(0.0, np.pi)
    texel = texel_m(half_size_m)
    long_m, wide_m = rng.uniform(0.008, 0.03), rng.uniform(0.12e-3, 0.25e-3)
    # one column a fifth of a scratch's length: little to draw, and smooth between
    reach_m = 1.5 * half_size_m
    step_m = long_m / 5.0
    rows, columns = int(2.0 * reach_m / texel), int(2.0 * reach_m / step_m) + 2
    lines = rng.standard_normal((rows, columns), dtype=np.float32)
    lines = np.asarray(cv2.GaussianBlur(lines, (0, 0), sigmaX=2.0, sigmaY=wide_m / texel), dtype=np.float32)
    c, s = float(np.cos(lay)), float(np.sin(lay))
    # from texel (column, row) to (along, across) in `lines`
    middle = (SIZE - 1) / 2.0
    turn = np.array([[c * texel / step_m, s * texel / step_m, 0.0], [-s, c, 0.0]])
    turn[:, 2] = np.array([(columns - 1) / 2.0, (rows - 1) / 2.0]) - turn[:, :2] @ [middle, middle]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(lines, turn, (SIZE, SIZE), flags=flags, borderMode=cv2.BORDER_WRAP), np.float32)


def _speckled(finish: Finish, half_size_m: float, rng: np.random.Generator) -> Marks:
    """Grains of a size: of sand, of a cast skin, or clouds on paint."""
    least_m, most_m = {"blasted": (0.15e-3, 0.35e-3), "cast": (0.4e-3, 1.2e-3)}.get(finish, (4e-3, 10e-3))
    grain = rng.uniform(least_m, most_m) / texel_m(half_size_m)
    # coarse grains are drawn coarsely
    step = max(1, int(grain / 2.0))
    size = -(-SIZE // step)
    noise = rng.standard_normal((size, size), dtype=np.float32)
    noise = np.asarray(cv2.GaussianBlur(noise, (0, 0), grain / step), dtype=np.float32)
    if step > 1:
        noise = np.asarray(cv2.resize(noise, (size * step, size * step), interpolation=cv2.INTER_CUBIC), np.float32)
    return noise[:SIZE, :SIZE].copy()
