"""Find the dark hole in the bright plate: Otsu, enclosed regions, and the shape of its outline (here a cross)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.vision.refusals import CutOff, NoCross, TooDark, TwoCrosses

Grey = NDArray[np.uint8]

MIN_FACE_GREY = 25.0
BORDER_PX = 3
# tolerance of area over convex hull against the outline's (a Greek cross with arms three times as long as wide: 5/7);
# perspective and lit walls change it
SOLIDITY_OFF = (-0.115, 0.125)
MAX_ASPECT = 1.35
MAX_AREA_OFF = 1.7


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """The cross in one picture: its contour (n, 2), bounding box (left, top, width, height), centre (2,), px."""

    contour_px: Array
    box_px: tuple[int, int, int, int]
    centre_px: Array
    threshold: float
    face_grey: float


@dataclass(frozen=True, slots=True)
class ExpectedRegion:
    """The expected appearance of the hole near its nominal place: area (px) and centre (2,) (px) in a picture, area
    over that of its convex hull, and longer over shorter side of its tightest box."""

    area_px: float
    centre_px: tuple[float, float]
    solidity: float
    aspect: float


def solidity_and_aspect(corners_m: Array) -> tuple[float, float]:
    """For an outline (n, 2): area over its convex hull's, longer over shorter side of its tightest box."""
    outline = (corners_m / np.abs(corners_m).max() * 1e3).astype(np.float32).reshape(-1, 1, 2)
    (_, (side_a, side_b), _) = cv2.minAreaRect(outline)
    hull = cv2.contourArea(cv2.convexHull(outline))
    return float(cv2.contourArea(outline) / hull), float(max(side_a, side_b) / min(side_a, side_b))


def _holes(mask: Grey, expected: ExpectedRegion) -> tuple[list[NDArray[np.int32]], bool]:
    """Contours of dark regions enclosed in bright ones that look like the hole, and whether one touches the border."""
    contours, hierarchy = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    found: list[NDArray[np.int32]] = []
    cut_off = False
    height, width = mask.shape
    if not contours:
        return found, cut_off
    for contour, (_, _, _, parent) in zip(contours, hierarchy[0], strict=True):
        if parent < 0:
            continue
        area = float(cv2.contourArea(contour))
        if not expected.area_px / MAX_AREA_OFF < area < expected.area_px * MAX_AREA_OFF:
            continue
        hull = float(cv2.contourArea(cv2.convexHull(contour)))
        (_, (side_a, side_b), _) = cv2.minAreaRect(contour)
        aspect = max(side_a, side_b) / max(min(side_a, side_b), 1.0)
        low, high = (expected.solidity + off for off in SOLIDITY_OFF)
        if not low < area / hull < high or not aspect / MAX_ASPECT < expected.aspect < aspect * MAX_ASPECT:
            continue
        left, top, w, h = cv2.boundingRect(contour)
        if min(left, top, width - left - w, height - top - h) < BORDER_PX:
            cut_off = True
            continue
        found.append(np.asarray(contour, dtype=np.int32).reshape(-1, 2))
    return found, cut_off


def find_hole(grey: Grey, expected: ExpectedRegion, side: str) -> Region:
    """The one hole in a grey picture. `expected` sets only the shape and scale of the search and the test for a
    cut-off.

    Raises TooDark, NoCross, TwoCrosses, CutOff.
    """
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0)
    threshold, bright = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    face = float(np.median(smooth[bright > 0])) if np.any(bright) else 0.0
    if face < MIN_FACE_GREY:
        raise TooDark(f"{side}: the bright part is at grey {face:.0f}, want {MIN_FACE_GREY:.0f} or more")
    found, cut_off = _holes(np.asarray(bright, dtype=np.uint8), expected)
    # lit bore walls can be nearer to the plate's grey than to the background's: search again among the bright pixels
    if not found:
        plate = smooth[bright > 0]
        second, _ = cv2.threshold(plate.reshape(1, -1), 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        for level in (second, 0.5 * (second + face)):
            mask = (smooth > level).astype(np.uint8) * 255
            found, cut_here = _holes(mask, expected)
            cut_off = cut_off or cut_here
            if found:
                threshold = level
                break
    if len(found) > 1:
        raise TwoCrosses(f"{side}: {len(found)} regions look like the hole, want one")
    if not found:
        height, width = grey.shape
        u, v = expected.centre_px
        if cut_off or not (0.0 <= u < width and 0.0 <= v < height):
            raise CutOff(f"{side}: the hole is cut off by the edge of the picture")
        raise NoCross(f"{side}: no dark region has the shape of the hole and about {expected.area_px:.0f} px of area")
    contour = found[0]
    hull_moments = cv2.moments(cv2.convexHull(contour.reshape(-1, 1, 2)))
    centre = np.array([hull_moments["m10"], hull_moments["m01"]]) / hull_moments["m00"]
    left, top, w, h = cv2.boundingRect(contour)
    return Region(contour.astype(float), (left, top, w, h), centre, float(threshold), face)
