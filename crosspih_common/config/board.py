"""A ChArUco board by its pattern, in one line: "7x5:0.015:0.011:DICT_4X4_50".

Frame
-----
board frame {B}: origin at the outer corner of the top left square, x to the right, y down, z into the board, as OpenCV
4.6 and later have it; all lengths in metres.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array

PATTERN = re.compile(r"(\d+)x(\d+):([0-9.eE+-]+):([0-9.eE+-]+):(DICT_\w+)")
EXAMPLE = "9x6:0.02:0.015:DICT_4X4_50"
MAX_SQUARES = 40


@dataclass(frozen=True, slots=True)
class BoardPattern:
    """Squares across and down, the side of a square and of a marker, m, and the name of ArUco's dictionary."""

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str

    @classmethod
    def of(cls, text: str) -> BoardPattern:
        """Parse the line. Raises ValueError that says what is wrong and what the form is."""
        found = PATTERN.fullmatch(text.strip())
        how = f"write squares across x down, side of a square and of a marker in metres, dictionary: {EXAMPLE}"
        if found is None:
            raise ValueError(f"board {text!r}: {how}")
        try:
            square_m, marker_m = float(found[3]), float(found[4])
        except ValueError:
            raise ValueError(f"board {text!r}: {found[3]} or {found[4]} is no length; {how}") from None
        columns, rows = int(found[1]), int(found[2])
        if not (3 <= columns <= MAX_SQUARES and 3 <= rows <= MAX_SQUARES):
            raise ValueError(f"board {text!r}: {columns}x{rows} squares, want 3 to {MAX_SQUARES} each way")
        if not 0.0 < marker_m < square_m:
            raise ValueError(f"board {text!r}: a marker of {marker_m:g} m does not fit a square of {square_m:g} m")
        if square_m > 1.0:
            raise ValueError(f"board {text!r}: a square of {square_m:g} m; lengths are in metres, 20 mm is 0.02")
        return cls(columns, rows, square_m, marker_m, found[5])

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}:{self.square_m:g}:{self.marker_m:g}:{self.dictionary}"

    @property
    def size_m(self) -> Array:
        """Width and height (2,) of all squares, m."""
        return np.array([self.columns, self.rows]) * self.square_m

    @property
    def count(self) -> int:
        """How many inner corners there are."""
        return (self.columns - 1) * (self.rows - 1)

    def corners_m(self) -> Array:
        """The inner corners (n, 3) in the board's frame, by their ids: row by row from the top left."""
        columns, rows = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        flat = np.stack([columns.ravel(), rows.ravel(), np.zeros(columns.size)], axis=1)
        return np.asarray(flat * self.square_m, dtype=float)

    def outline_m(self) -> Array:
        """The four outer corners (4, 3) in the board's frame."""
        width, height = self.size_m
        return np.array([[0.0, 0.0, 0.0], [width, 0.0, 0.0], [width, height, 0.0], [0.0, height, 0.0]])
