"""What a face looks like close to: heights of a finish, and marks on it, as textures over `TEXTURE_EXTENT_M`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from crosspih_common.geometry.pose import Array
from services.operator.bench.pictures.tracing.solids import TEXTURE_EXTENT_M

FloatTexture = NDArray[np.float32]
SIZE = 1024
TEXEL_M = TEXTURE_EXTENT_M / SIZE
FINISHES = ("milled", "ground", "turned", "cast", "blasted")


def _grid_m() -> tuple[Array, Array]:
    line = (np.arange(SIZE) + 0.5) * TEXEL_M - TEXTURE_EXTENT_M / 2
    x, y = np.meshgrid(line, line)
    return x, y


def _scaled(heights: Array, slope: float) -> FloatTexture:
    """Heights, m, whose slope has this standard deviation."""
    dy, dx = np.gradient(heights, TEXEL_M)
    spread = float(np.sqrt(np.mean(dx**2 + dy**2) / 2.0))
    return np.asarray(heights * (slope / max(spread, 1e-12)), dtype=np.float32)


def heights_of(finish: str, slope: float, rng: np.random.Generator) -> FloatTexture:
    """Heights (SIZE, SIZE), m, of a finish whose slopes have a standard deviation, rad."""
    x, y = _grid_m()
    turn = rng.uniform(0.0, np.pi)
    along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    if finish == "milled":
        # passes of an end mill: arcs about a centre that moves on with the feed
        radius, feed = rng.uniform(0.008, 0.025), rng.uniform(0.0006, 0.0015)
        width = 1.6 * radius
        lane = np.round(across / width)
        off = across - lane * width
        front = along - np.sqrt(np.maximum(radius**2 - off**2, 0.0)) * np.where(lane % 2 == 0, 1.0, -1.0)
        heights = np.abs(np.sin(np.pi * front / feed)) * feed
        heights = heights + gaussian_filter(rng.standard_normal(x.shape), 2.0) * feed * 0.5
    elif finish == "ground":
        lines = gaussian_filter(rng.standard_normal(x.shape), (1.2, 60.0))
        fine = gaussian_filter(rng.standard_normal(x.shape), (0.7, 200.0))
        heights = _turned_about(lines / lines.std() + fine / fine.std(), turn)
    elif finish == "turned":
        centre = rng.uniform(-0.004, 0.004, 2)
        r = np.hypot(x - centre[0], y - centre[1])
        feed = rng.uniform(0.0005, 0.0012)
        grooves = np.interp(r, np.linspace(0.0, 0.2, 1200), rng.standard_normal(1200).cumsum() * 0.02)
        heights = np.abs(np.sin(np.pi * r / feed)) * feed + grooves * feed
    elif finish == "cast":
        heights = gaussian_filter(rng.standard_normal(x.shape), 3.0) + 4.0 * gaussian_filter(
            rng.standard_normal(x.shape), 9.0
        )
    else:
        heights = gaussian_filter(rng.standard_normal(x.shape), 1.5)
    return _scaled(np.asarray(heights, dtype=float), slope)


def _turned_about(texture: Array, turn_rad: float) -> Array:
    from scipy.ndimage import affine_transform

    c, s = np.cos(turn_rad), np.sin(turn_rad)
    matrix = np.array([[c, -s], [s, c]])
    middle = np.full(2, (SIZE - 1) / 2)
    return np.asarray(affine_transform(texture, matrix, middle - matrix @ middle, order=1, mode="wrap"))


def blotches(rng: np.random.Generator, spread: float, grain: float = 0.0) -> FloatTexture:
    """(SIZE, SIZE): a factor about 1 that wanders slowly over the face, with a fine grain."""
    coarse = sum(
        weight * gaussian_filter(rng.standard_normal((SIZE // 8, SIZE // 8)), sigma) * sigma
        for sigma, weight in ((2.0, 0.5), (6.0, 1.0), (14.0, 1.5))
    )
    factor = np.kron(np.asarray(coarse), np.ones((8, 8)))
    factor = gaussian_filter(factor, 6.0)
    factor = 1.0 + spread * (factor - factor.mean()) / factor.std()
    if grain:
        fine = gaussian_filter(rng.standard_normal((SIZE, SIZE)), 1.0)
        factor = factor + grain * fine / fine.std()
    return np.asarray(np.clip(factor, 0.2, 2.0), dtype=np.float32)


def with_marks(texture: FloatTexture, rng: np.random.Generator, keep_out_m: float) -> FloatTexture:
    """The texture with text, scribed lines, scratches and stains drawn on it, as a workshop leaves them."""
    import cv2

    drawn = texture.copy()

    def texel(point_m: Array) -> tuple[int, int]:
        x, y = (np.asarray(point_m) / TEXEL_M + SIZE / 2).astype(int)
        return int(x), int(y)

    def scratch(start_m: Array, end_m: Array, factor: float) -> None:
        mask = np.zeros(drawn.shape, dtype=np.uint8)
        cv2.line(mask, texel(start_m), texel(end_m), 255, 1, cv2.LINE_AA)
        drawn[:] *= 1.0 + (factor - 1.0) * mask.astype(np.float32) / 255.0

    for _ in range(rng.integers(1, 4)):
        side = rng.integers(4)
        place = rng.uniform(-0.8, 0.8, 2) * keep_out_m
        place[side % 2] = (1 if side < 2 else -1) * rng.uniform(1.05, 1.25) * keep_out_m
        text = f"{rng.choice(['A', 'REV', 'Nr', 'OK', 'PIH'])} {rng.integers(10, 9999)}"
        mask = np.zeros(drawn.shape, dtype=np.uint8)
        scale, thick = float(rng.uniform(0.6, 1.3)), int(rng.integers(2, 4))
        cv2.putText(mask, text, texel(place), cv2.FONT_HERSHEY_SIMPLEX, scale, 255, thick, cv2.LINE_AA)
        drawn *= 1.0 - rng.uniform(0.5, 0.85) * mask.astype(np.float32) / 255.0
    for _ in range(rng.integers(2, 12)):
        start = rng.uniform(-0.06, 0.06, 2)
        end = start + rng.uniform(-0.04, 0.04, 2)
        scratch(start, end, float(rng.choice([0.4, 0.6, 1.4])))
    if rng.random() < 0.5:
        # a line scribed right through the middle, to mark the hole out
        turn = rng.choice([0.0, np.pi / 2]) + rng.normal(0.0, 0.02)
        way = 0.07 * np.array([np.cos(turn), np.sin(turn)])
        scratch(-way, way, float(rng.choice([0.3, 0.5, 1.6])))
    for _ in range(rng.integers(0, 4)):
        radius = rng.uniform(0.002, 0.009)
        mask = np.zeros(drawn.shape, dtype=np.uint8)
        cv2.circle(mask, texel(rng.uniform(-0.05, 0.05, 2)), int(radius / TEXEL_M), 255, -1, cv2.LINE_AA)
        drawn *= 1.0 - rng.uniform(0.1, 0.5) * gaussian_filter(mask.astype(np.float32) / 255.0, 8.0)
    return np.asarray(np.clip(drawn, 0.05, 2.0), dtype=np.float32)
