"""Refines the corners of a checkered board by laying its drawing over the picture, one corner at a time.

`cv2.cornerSubPix` looks for gradients in a square window. On a board that is tilted by 50 degrees, a window that
excludes the markers is only about two pixels wide, and one corner in twenty is then off by a quarter of a pixel or
more. Here the four squares around a corner are drawn as the picture would show them (perspective, the area of each
pixel, the picture's blur) and shifted until they fit, along the whole sides of the squares (Lucas and Kanade 1981, with
a gain and an offset per corner, as in Baker and Matthews 2004). Pixels reached by the blur of a marker are left out:
on boards drawn from pixels, the place of a marker within its square is not exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from crosspih_common.config.board import BoardPattern
from crosspih_common.geometry.pose import Array

HALF, MAX_HALF_PX = 0.5, 20.0  # of a square: how far the window reaches along the sides, and at most
SUBPIXELS = 3  # in each direction
MIN_BLUR_PX, MAX_BLUR_PX, BLUR_FOUND_PX = 0.35, 3.0, 0.03
BLUR_CORNERS = 8  # the blur is measured from this many corners
# pixels nearer to a marker than this many blurs are left out; the blur to assume while it is not measured
GUARD_BLURS, USUAL_BLUR_PX = 1.5, 0.8
STEPS, DONE_PX, STUCK_PX, MAX_STEP_PX = 5, 5e-3, 0.03, 1.5
MIN_PIXELS, MIN_CONTRAST, MAX_SD_PX = 16, 4.0, 0.15
WILD_SD, WILD_PX = 4.0, 0.1
TERMS, BENT_FROM = (10, 6), (20, 12)  # third-order and second-order fit: number of terms; corners needed for each


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """Pixels (n, 2), which of them are sound (n,), and the standard deviation of each coordinate (n,), px."""

    pixels: Array
    sound: NDArray[np.bool_]
    sd_px: Array


class _Board:
    """Maps squares to pixels and back: a homography, and the lens's bend (px) to third order. Lens distortion grows
    with the cube of the distance from the middle, and an unmodelled bend would shift a corner."""

    def __init__(self, to_pixels: Array, middle: Array) -> None:
        self._to_pixels, self._middle = to_pixels, middle
        self._to_squares = np.asarray(np.linalg.inv(to_pixels), dtype=float)
        self.bent = np.zeros((TERMS[0], 2))

    def terms(self, squares: Array) -> Array:
        """(..., 10): all products up to the third order."""
        x, y = np.moveaxis(squares - self._middle, -1, 0)
        xx, xy, yy = x * x, x * y, y * y
        return np.stack([np.ones_like(x), x, y, xx, xy, yy, xx * x, xx * y, x * yy, y * yy], axis=-1)

    def straight_px(self, squares: Array) -> Array:
        """The pixels without the lens's bend."""
        return _mapped(self._to_pixels, np.asarray(squares, dtype=float))

    def px(self, squares: Array) -> Array:
        """(..., 2): pixels of places in squares (..., 2)."""
        return np.asarray(self.straight_px(squares) + self.terms(squares) @ self.bent, dtype=float)

    def squares(self, pixels: Array) -> Array:
        """(..., 2): places in squares, from pixels."""
        squares = _mapped(self._to_squares, pixels)
        if np.any(self.bent):
            for _ in range(2):
                squares = _mapped(self._to_squares, np.asarray(pixels - self.terms(squares) @ self.bent, dtype=float))
        return squares

    def per_square(self, squares: Array) -> Array:
        """(2, 2): pixels per square along the board's x and y (columns), at one place."""
        step = 0.01
        ahead, behind = squares + step * np.eye(2), squares - step * np.eye(2)
        return np.asarray((self.straight_px(ahead) - self.straight_px(behind)).T / (2.0 * step))


class _Window:
    """The surroundings of a corner in the picture, and the drawing of its four squares there."""

    def __init__(self, picture: Array, corner: Array, board: _Board, marker: float) -> None:
        self._corner, self._board, self._marker = corner, board, marker
        self._start = board.px(corner)
        per_square = board.per_square(corner)
        self._per_pixel = np.linalg.inv(per_square)
        self._half = np.minimum(HALF, MAX_HALF_PX / np.linalg.norm(per_square, axis=0))
        reach = np.ceil(np.abs(per_square) @ self._half).astype(int) + 3
        middle, size = np.rint(self._start).astype(int), np.array(picture.shape[::-1])
        low, high = np.maximum(middle - reach, 0), np.minimum(middle + reach + 1, size)
        self.empty = bool(np.any(high - low < 5))
        if self.empty:
            return
        self._columns, self._rows = np.arange(low[0], high[0]), np.arange(low[1], high[1])
        self._grey = picture[low[1] : high[1], low[0] : high[0]]
        self._pixels = np.stack(np.meshgrid(self._columns, self._rows), axis=-1).astype(float)

    def drawn(self, shift: Array) -> Array:
        """(rows, columns): the white share of each pixel, for the drawing shifted by `shift` (2,), px."""
        inside = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
        x, y = (self._columns[:, None] + inside).ravel(), (self._rows[:, None] + inside).ravel()
        squares = self._board.squares(np.stack(np.meshgrid(x, y), axis=-1) - shift)
        white = np.floor(squares).astype(int).sum(axis=-1) % 2 != 0
        shape = len(self._rows), SUBPIXELS, len(self._columns), SUBPIXELS
        return np.asarray(white.reshape(shape).mean(axis=(1, 3)), dtype=float)

    def looked_at(self, shift: Array, guard_px: float) -> NDArray[np.bool_]:
        """(rows, columns): pixels near the corner that keep the guard distance from every marker."""
        away = (self._pixels - self._start - shift) @ self._per_pixel.T
        near = np.all(np.abs(away) < self._half, axis=-1)
        near[:2] = near[-2:] = False
        near[:, :2] = near[:, -2:] = False
        squares = self._corner + away
        white = np.floor(squares).astype(int).sum(axis=-1) % 2 != 0
        guard = 0.5 * self._marker + guard_px * np.linalg.norm(self._per_pixel, axis=1)
        marked = np.all(np.abs(squares - np.floor(squares) - 0.5) < guard, axis=-1)
        return np.asarray(near & ~(white & marked))

    def laid_over(
        self, drawn: Array, shift: Array, blur_px: float, guard_px: float
    ) -> tuple[Array, Array, Array] | None:
        """Offset, gain and gain times the remaining shift (4,), the residual greys (m,), and the design matrix (m, 4);
        None where too little is seen."""
        blurred = cv2.GaussianBlur(drawn, (0, 0), blur_px, borderType=cv2.BORDER_REPLICATE)
        kept = self.looked_at(shift, guard_px)
        if int(kept.sum()) < MIN_PIXELS:
            return None
        down, across = np.gradient(blurred)
        design = np.stack([np.ones(int(kept.sum())), blurred[kept], -across[kept], -down[kept]], axis=1)
        normal = design.T @ design
        if np.linalg.cond(normal) > 1e8:
            return None
        grey = self._grey[kept]
        found = np.linalg.solve(normal, design.T @ grey)
        return found, grey - design @ found, design

    def registered(self, drawn: Array, blur_px: float) -> tuple[Array, float] | None:
        """The corner's place (2,), px, and its standard deviation; None if the iteration does not settle."""
        shift = np.zeros(2)
        for number in range(STEPS):
            laid = self.laid_over(drawn if number == 0 else self.drawn(shift), shift, blur_px, GUARD_BLURS * blur_px)
            if laid is None or laid[0][1] < MIN_CONTRAST:
                return None
            found, left, design = laid
            step = found[2:] / found[1]
            shift = shift + np.clip(step, -MAX_STEP_PX, MAX_STEP_PX)
            if float(np.linalg.norm(step)) < DONE_PX:
                break
        if float(np.linalg.norm(step)) > STUCK_PX:
            return None
        noise = float(left @ left) / max(len(left) - 4, 1)
        sd_px = float(np.sqrt(0.5 * noise * np.trace(np.linalg.inv(design.T @ design)[2:, 2:])) / found[1])
        return self._start + shift, sd_px


def register_corners(picture: NDArray[np.uint8], pixels: Array, squares: Array, pattern: BoardPattern) -> Registered:
    """Refine the corners at `squares` (n, 2), in squares from the board's top left, from rough places (n, 2), px.

    No corner is sound if the rough ones do not lie on a board in perspective.
    """
    lost = Registered(pixels, np.zeros(len(pixels), dtype=bool), np.full(len(pixels), np.nan))
    found, _ = cv2.findHomography(squares, pixels, cv2.RANSAC, 3.0)
    to_pixels = np.asarray(found, dtype=float)
    if to_pixels.shape != (3, 3) or abs(np.linalg.det(to_pixels)) < 1e-12:
        return lost
    board, grey = _Board(to_pixels, squares.mean(axis=0)), picture.astype(float)
    marker, now, blur_px = pattern.marker_m / pattern.square_m, lost, 0.0
    for number in range(2):  # the second time with the lens's bend
        windows = [_Window(grey, corner, board, marker) for corner in squares]
        drawn = [np.zeros((0, 0)) if window.empty else window.drawn(np.zeros(2)) for window in windows]
        blur_px = blur_px or _blur_px(windows, drawn)
        if blur_px < MIN_BLUR_PX + BLUR_FOUND_PX:
            # a drawing, not a camera picture: without blur the place of an edge between pixels is undefined
            return lost
        now = _all(windows, drawn, blur_px, pixels)
        if number == 0 and not _bend(board, squares, now):
            break
    return now


def _all(windows: list[_Window], drawn: list[Array], blur_px: float, pixels: Array) -> Registered:
    where, sd_px = np.array(pixels, dtype=float), np.full(len(pixels), np.nan)
    for index, (window, one) in enumerate(zip(windows, drawn, strict=True)):
        found = None if window.empty else window.registered(one, blur_px)
        if found is not None:
            where[index], sd_px[index] = found
    return Registered(where, sd_px < MAX_SD_PX, sd_px)


def _blur_px(windows: list[_Window], drawn: list[Array]) -> float:
    """One blur for the whole picture: the one with the least residual over some corners, spread over the board."""
    there = [index for index, window in enumerate(windows) if not window.empty]
    some = [there[int(one)] for one in np.linspace(0, len(there) - 1, min(BLUR_CORNERS, len(there)))]

    def left(blur_px: float) -> float:
        total, count = 0.0, 0
        for index in some:
            laid = windows[index].laid_over(drawn[index], np.zeros(2), blur_px, GUARD_BLURS * USUAL_BLUR_PX)
            if laid is not None:
                total, count = total + float(laid[1] @ laid[1]), count + len(laid[1])
        return total / count if count else 0.0

    bounds = (MIN_BLUR_PX, MAX_BLUR_PX)
    return float(minimize_scalar(left, bounds=bounds, method="bounded", options={"xatol": BLUR_FOUND_PX}).x)


def _bend(board: _Board, squares: Array, now: Registered) -> bool:
    """Fit the lens's bend into the board's mapping; False if too few corners support it."""
    off, kept = now.pixels - board.straight_px(squares), now.sound
    for _ in range(3):
        enough = [count for count, needed in zip(TERMS, BENT_FROM, strict=True) if int(kept.sum()) >= needed]
        if not enough:
            return False
        terms = board.terms(squares)[:, : enough[0]]
        bent = np.linalg.lstsq(terms[kept], off[kept], rcond=None)[0]
        left = np.linalg.norm(off - terms @ bent, axis=1)
        kept = now.sound & (left < max(WILD_SD * float(np.median(left[now.sound])), WILD_PX))
    board.bent = np.zeros_like(board.bent)
    board.bent[: enough[0]] = bent
    return True


def _mapped(matrix: Array, points: Array) -> Array:
    """(..., 2): points mapped by a homography."""
    mapped = points @ matrix[:, :2].T + matrix[:, 2]
    return np.asarray(mapped[..., :2] / mapped[..., 2:], dtype=float)
