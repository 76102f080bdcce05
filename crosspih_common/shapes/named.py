"""The outlines that have a name, all of about the cross's size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.outline import Outline
from crosspih_common.shapes.peg import Peg

RADIUS_M = 0.027
ROUND_RADIUS_M = 0.022
ROUND_SIDES = 48
"""Sides of a round's polygon. Peg and hole are both polygons: with 22 mm of radius and 0.1 mm of clearance a side, a
round has 0.100 mm flat to flat when their sides are aligned and 0.053 mm corner to flat when they are not."""
ARC_SIDES = 32
"""Sides a full turn of the arcs of toothed outlines, whose teeth keep peg and hole aligned."""
CAPTURE_M = 0.005
MIN_TIP_SCALE = 0.25


@dataclass(frozen=True, slots=True)
class Sizes:
    """What a named outline is drawn from, metres; None takes the outline's own default.

    `radius_m`: the farthest corner; a round's radius. `inner_radius_m`: a star's inward corners, a spline's root, a
    keyed round's round. `tooth_half_width_m`: of a spline's tooth or of the key. `count`: a star's points, a spline's
    teeth.
    """

    radius_m: float | None = None
    inner_radius_m: float | None = None
    tooth_half_width_m: float | None = None
    count: int | None = None


def regular_polygon(count: int, radius_m: float, turn_rad: float = 0.0) -> Array:
    """(count, 2): corners on a circle, m, the first one at `turn_rad` from +x."""
    angles = turn_rad + np.arange(count) * (2.0 * np.pi / count)
    return radius_m * np.column_stack([np.cos(angles), np.sin(angles)])


def star(count: int, radius_m: float, inner_radius_m: float) -> Array:
    """(2 count, 2): points at the radius, the first one along +x, inward corners between them, m."""
    points = regular_polygon(2 * count, 1.0)
    return points * np.where(np.arange(2 * count) % 2 == 0, radius_m, inner_radius_m)[:, None]


def toothed_round(count: int, radius_m: float, inner_radius_m: float, tooth_half_width_m: float) -> Array:
    """(n, 2): a round with straight-sided teeth, the first one along +x, m; a single tooth makes a keyed round."""
    w = tooth_half_width_m
    foot = float(np.arcsin(min(1.0, w / inner_radius_m)))
    if w >= inner_radius_m or foot >= np.pi / count:
        raise ValueError(
            f"tooth_half_width_m is {w:g}: {count} teeth so wide do not fit round inner_radius_m, {inner_radius_m:g}"
        )
    top = float(np.sqrt(radius_m**2 - w**2))
    gap = 2.0 * np.pi / count - 2.0 * foot
    steps = max(1, round(gap / (2.0 * np.pi / ARC_SIDES)))
    corners: list[Array] = []
    for tooth in range(count):
        middle = tooth * 2.0 * np.pi / count
        turn = np.array([[np.cos(middle), np.sin(middle)], [-np.sin(middle), np.cos(middle)]])
        corners.append(np.array([[top, -w], [top, w]]) @ turn)
        arc = middle + foot + gap * np.linspace(0.0, 1.0, steps + 1)
        corners.append(inner_radius_m * np.column_stack([np.cos(arc), np.sin(arc)]))
    return np.vstack(corners)


def _square(sizes: Sizes) -> Outline:
    return Outline.of("square", regular_polygon(4, sizes.radius_m or RADIUS_M, np.pi / 4.0), 4)


def _triangle(sizes: Sizes) -> Outline:
    return Outline.of("triangle", regular_polygon(3, sizes.radius_m or RADIUS_M), 3)


def _hexagon(sizes: Sizes) -> Outline:
    return Outline.of("hexagon", regular_polygon(6, sizes.radius_m or RADIUS_M), 6)


def _star(sizes: Sizes) -> Outline:
    count = sizes.count or 5
    return Outline.of("star", star(count, *_radii(sizes, 0.013)), count)


def _spline(sizes: Sizes) -> Outline:
    count = sizes.count or 6
    tooth_m = sizes.tooth_half_width_m or 0.004
    return Outline.of("spline", toothed_round(count, *_radii(sizes, 0.014), tooth_m), count)


def _keyway(sizes: Sizes) -> Outline:
    return Outline.of("keyway", toothed_round(1, *_radii(sizes, 0.016), sizes.tooth_half_width_m or 0.005), 1)


def _round(sizes: Sizes) -> Outline:
    return Outline.of("round", regular_polygon(ROUND_SIDES, sizes.radius_m or ROUND_RADIUS_M), 0)


def _radii(sizes: Sizes, inner_m: float) -> tuple[float, float]:
    """(radius_m, inner_radius_m), the defaults put in."""
    radius_m, inner_m = sizes.radius_m or RADIUS_M, sizes.inner_radius_m or inner_m
    if not inner_m < radius_m:
        raise ValueError(f"inner_radius_m is {inner_m:g}, want less than radius_m, {radius_m:g}")
    return radius_m, inner_m


NAMED: dict[str, Callable[[Sizes], Outline]] = {
    "square": _square,
    "triangle": _triangle,
    "hexagon": _hexagon,
    "star": _star,
    "spline": _spline,
    "keyway": _keyway,
    "round": _round,
}
"""Every named outline but the cross, which has the paper's own numbers."""


def tip_scale_of(outline: Outline, taper_slope: float, taper_length_m: float) -> float:
    """How large the tip is, as a share of the body, where the drawing does not say.

    The nearest wall loses `taper_slope` a length, as the cross's arms do, or more: the tip fits at any turn, and 5 mm
    off the axis, into the largest circle about the axis, so that what touches first is an edge of the taper.
    """
    by_slope = 1.0 - taper_slope * taper_length_m / outline.inner_radius_m
    by_capture = (outline.inner_radius_m - CAPTURE_M) / outline.radius_m
    return max(MIN_TIP_SCALE, min(by_slope, by_capture))


def tapered(outline: Outline, body_start_m: float, taper_start_m: float, tip_m: float, tip_scale: float) -> Peg:
    """The peg with a section, its tip that share of the body; lengths from the F/T origin, m."""
    if not 0.0 < tip_scale < 1.0:
        raise ValueError(f"tip_scale is {tip_scale:g}, want more than 0 and less than 1")
    apex_m = taper_start_m + (tip_m - taper_start_m) / (1.0 - tip_scale)
    return Peg(outline, body_start_m, taper_start_m, apex_m, tip_m)
