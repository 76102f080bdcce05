"""The board in OpenCV's terms: finds its corners in pictures, and gives its drawing in true size."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.config.board import BoardPattern
from crosspih_common.errors import ConfigError
from crosspih_common.geometry.pose import Array
from services.vision.calibration.registration import register_corners

FINE_SIDE_PX = 1200  # a picture with a shorter side is enlarged to find its markers
MIN_CORNERS = 6
REFINE_SHARE, MIN_WINDOW_PX, MAX_WINDOW_PX = 0.9, 2, 8
REFINE_STEPS = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
MIN_REGISTERED_SHARE = 0.5  # of the corners; where fewer were registered, all are refined by their gradients
MAX_MOVED_SHARE = 0.25  # of a square: a corner that moved farther in the refinement is a different one


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """What one picture shows of the board: ids (n,) of inner corners and their pixels (n, 2)."""

    ids: NDArray[np.int64]
    pixels: Array

    def __len__(self) -> int:
        return len(self.ids)


NONE = Corners(np.zeros(0, dtype=np.int64), np.zeros((0, 2)))


class Board:
    """A pattern with OpenCV's dictionary. Raises ConfigError if no dictionary has that name, or it has too few
    markers."""

    def __init__(self, pattern: BoardPattern) -> None:
        self.pattern = pattern
        number = getattr(cv2.aruco, pattern.dictionary, None)
        if number is None:
            names = ", ".join(name for name in dir(cv2.aruco) if name.startswith("DICT_") and "ARUCO" not in name)
            raise ConfigError(f"board: OpenCV has no dictionary {pattern.dictionary}; it has {names}")
        dictionary = cv2.aruco.getPredefinedDictionary(number)
        markers = pattern.columns * pattern.rows // 2
        if len(dictionary.bytesList) < markers:
            raise ConfigError(
                f"board: {pattern.dictionary} has {len(dictionary.bytesList)} markers, {pattern} needs {markers}; take "
                "a larger dictionary"
            )
        self._board = cv2.aruco.CharucoBoard(
            (pattern.columns, pattern.rows), pattern.square_m, pattern.marker_m, dictionary
        )
        self._dictionary = dictionary
        charuco = cv2.aruco.CharucoParameters()
        charuco.tryRefineMarkers = True  # small or tilted markers with uncertain bits are found by their expected place
        self._detector = cv2.aruco.CharucoDetector(self._board, charuco)

    def find(self, picture: NDArray[np.uint8]) -> Corners:
        """The corners in a grey picture, refined; none if fewer than six are certain, or all lie on one line."""
        times = int(np.ceil(FINE_SIDE_PX / min(picture.shape)))
        looked_at = picture
        if times > 1:
            larger = cv2.resize(picture, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
            looked_at = np.asarray(larger, dtype=np.uint8)
        found, ids, _, _ = self._detector.detectBoard(looked_at)
        if ids is None or len(ids) < MIN_CORNERS:
            return NONE
        pixels = np.asarray(found, dtype=float).reshape(-1, 2)
        pixels = (pixels + 0.5) / times - 0.5
        order = np.argsort(ids.ravel())
        corners = Corners(np.asarray(ids.ravel()[order], dtype=np.int64), pixels[order])
        where = self.pattern.corners_m()[corners.ids][:, :2]
        if np.linalg.matrix_rank(where - where.mean(axis=0), tol=1e-6) < 2:
            return NONE
        return self._registered(picture, corners) or self._refined(picture, corners)

    def _registered(self, picture: NDArray[np.uint8], corners: Corners) -> Corners | None:
        """Refined by laying the drawing over the picture; None where the squares are too small in it for that."""
        where = self.pattern.corners_m()[corners.ids][:, :2]
        found = register_corners(picture, corners.pixels, where / self.pattern.square_m, self.pattern)
        if int(found.sound.sum()) < max(MIN_CORNERS, MIN_REGISTERED_SHARE * len(corners)):
            return None
        return Corners(corners.ids[found.sound], found.pixels[found.sound])

    def _refined(self, picture: NDArray[np.uint8], corners: Corners) -> Corners:
        """Refined by gradients in a window that no marker reaches into, of its own size for each corner."""
        where = self.pattern.corners_m()[corners.ids][:, :2]
        found = cv2.findHomography(where, corners.pixels, cv2.RANSAC, 3.0)
        to_pixels = np.asarray(found[0], dtype=float)
        if to_pixels.shape != (3, 3):
            return NONE
        side_px = _side_px(to_pixels, where, self.pattern.square_m)
        free = REFINE_SHARE * 0.5 * (1.0 - self.pattern.marker_m / self.pattern.square_m) * side_px
        windows = np.clip(np.floor(free), MIN_WINDOW_PX, MAX_WINDOW_PX).astype(int)
        refined = corners.pixels.copy()
        for window in np.unique(windows):
            here = np.flatnonzero(windows == window)
            start = corners.pixels[here].astype(np.float32).reshape(-1, 1, 2).copy()
            moved = cv2.cornerSubPix(picture, start, (int(window), int(window)), (-1, -1), REFINE_STEPS)
            refined[here] = np.asarray(moved, dtype=float).reshape(-1, 2)
        sound = np.linalg.norm(refined - corners.pixels, axis=1) < MAX_MOVED_SHARE * side_px
        height, width = picture.shape
        sound &= np.all((refined > windows[:, None]) & (refined < np.array([width, height]) - 1 - windows[:, None]), 1)
        if int(sound.sum()) < MIN_CORNERS:
            return NONE
        return Corners(corners.ids[sound], refined[sound])

    def black_m(self) -> list[Array]:
        """All black areas, as rectangles (left, top, width, height), m from the top left of the board."""
        pattern, found = self.pattern, []
        side = pattern.square_m
        for row in range(pattern.rows):
            for column in range(pattern.columns):
                if (row + column) % 2 == 0:
                    found.append(np.array([column * side, row * side, side, side]))
        bits = self._dictionary.markerSize + 2
        cell = pattern.marker_m / bits
        for number, corners in zip(np.asarray(self._board.getIds()).ravel(), self._board.getObjPoints(), strict=True):
            left, top = np.asarray(corners)[:, :2].min(axis=0)
            drawn = self._dictionary.generateImageMarker(int(number), bits, borderBits=1)
            for row, column in np.argwhere(np.asarray(drawn) < 128):
                found.append(np.array([left + column * cell, top + row * cell, cell, cell]))
        return found


def _side_px(to_pixels: Array, where_m: Array, square_m: float) -> Array:
    """(n,): how wide a square at each corner (n, 2) appears, px: the distance between its nearer two sides."""

    def seen(points: Array) -> Array:
        mapped = np.column_stack([points, np.ones(len(points))]) @ to_pixels.T
        return np.asarray(mapped[:, :2] / mapped[:, 2:])

    half = 0.5 * square_m
    across = seen(where_m + np.array([half, 0.0])) - seen(where_m - [half, 0.0])
    down = seen(where_m + np.array([0.0, half])) - seen(where_m - [0.0, half])
    area = np.abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0])
    return np.asarray(area / np.maximum(np.linalg.norm(across, axis=1), np.linalg.norm(down, axis=1)))
