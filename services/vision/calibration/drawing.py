"""Draws a picture of the board for people: its corners, the parts covered so far, and the outline wanted next."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.vision.calibration.boards import Corners
from services.vision.calibration.coverage import MIN_IN_PART

WIDE_PX = 900  # larger pictures are drawn smaller
# blue, green, red
SEEN, FOUND, OPEN, NEXT, WORDS = (200, 150, 60), (60, 220, 60), (40, 150, 255), (220, 80, 220), (255, 255, 255)
OPEN_SHARE = 0.25
JPEG_QUALITY = 85


def drawn(
    grey: NDArray[np.uint8], corners: Corners, before: list[Corners], counts: list[list[int]], wanted_px: Array | None
) -> NDArray[np.uint8]:
    """One camera's picture (height, width), in colour and at most `WIDE_PX` wide.

    `before` are the corners of its other pictures, `counts` (3 x 3) how many fell into each part, these included; a
    part with too few is tinted. `wanted_px` (n, 2) is the outline that the board should have next.
    """
    scale = min(1.0, WIDE_PX / grey.shape[1])
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1.0 else grey
    shown = np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    height, width = shown.shape[:2]

    def at(pixels: Array) -> NDArray[np.int32]:
        return np.asarray(np.rint((np.asarray(pixels, float) + 0.5) * scale - 0.5), dtype=np.int32)

    edges = [(width * step // 3, height * step // 3) for step in range(4)]
    for row in range(3):
        for column in range(3):
            (left, _), (right, _) = edges[column], edges[column + 1]
            (_, top), (_, bottom) = edges[row], edges[row + 1]
            if counts[row][column] < MIN_IN_PART:
                part = shown[top:bottom, left:right]
                part[:] = np.rint(part * (1.0 - OPEN_SHARE) + np.array(OPEN) * OPEN_SHARE).astype(np.uint8)
            cv2.rectangle(shown, (left, top), (right - 1, bottom - 1), SEEN, 1)
            _say(shown, str(counts[row][column]), (left + 6, bottom - 8))
    for one in before:
        for u, v in at(one.pixels):
            cv2.circle(shown, (int(u), int(v)), 2, SEEN, -1, cv2.LINE_AA)
    for u, v in at(corners.pixels):
        cv2.circle(shown, (int(u), int(v)), 4, FOUND, 1, cv2.LINE_AA)
    if wanted_px is not None:
        outline = at(wanted_px)
        cv2.polylines(shown, [outline.reshape(-1, 1, 2)], True, NEXT, 2, cv2.LINE_AA)
        _say(shown, "next", (int(outline[0, 0]) + 4, int(outline[0, 1]) + 16), NEXT)
    return shown


def _say(shown: NDArray[np.uint8], text: str, at: tuple[int, int], colour: tuple[int, int, int] = WORDS) -> None:
    for width, ink in ((3, (0, 0, 0)), (1, colour)):
        cv2.putText(shown, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, ink, width, cv2.LINE_AA)


def write_drawn(shown: NDArray[np.uint8], path: Path) -> None:
    """Write a JPEG; it replaces the file in one step. Raises OSError."""
    done, data = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert done, "OpenCV writes JPEG"
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(data.tobytes())
    os.replace(partial, path)
