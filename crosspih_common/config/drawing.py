"""The drawings of the peg and of its hole, as a cell's file gives them."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator

from crosspih_common.config.section import Section
from crosspih_common.config.spelling import did_you_mean
from crosspih_common.errors import ConfigError
from crosspih_common.shapes import CrossPeg, Hole, Outline, Peg
from crosspih_common.shapes.importing import FILE_SUFFIXES, DrawingRead, outline_from_file, read_drawing
from crosspih_common.shapes.named import NAMED, Sizes, tapered, tip_scale_of

# the shapes' own defaults: the peg that the paper used
_CROSS = CrossPeg()

CROSS = "cross"
OUTLINES = (CROSS, *NAMED)

MIN_INNER_RADIUS_M = 1e-3
"""A thinner peg would be lost among the clearance, the chamfer and what vision and touch can tell."""

_CROSS_ONLY = ("half_width_m", "half_length_m", "apex_m", "tip_half_width_m")
_BUT_CROSS = ("taper_start_m", "tip_m", "tip_scale")
_SIZES = ("radius_m", "inner_radius_m", "tooth_half_width_m", "count")
_SIZES_OF = {
    "square": ("radius_m",),
    "triangle": ("radius_m",),
    "hexagon": ("radius_m",),
    "round": ("radius_m",),
    "star": ("radius_m", "inner_radius_m", "count"),
    "spline": _SIZES,
    "keyway": ("radius_m", "inner_radius_m", "tooth_half_width_m"),
}


class PegDrawing(Section):
    """The peg's drawing, metres from the F/T origin along the peg axis.

    `outline` is cross, square, triangle, hexagon, star, spline, keyway (a round with a key), round, or an SVG or DXF
    file; with `corners_m` it is only the name of that polygon.
    """

    outline: str = Field(default=CROSS, min_length=1)
    corners_m: tuple[tuple[float, float], ...] | None = Field(
        default=None, description="(x, y) about the peg's axis, for a section that has no name here"
    )
    body_start_m: float = _CROSS.body_start_m
    taper_slope: float = Field(default=_CROSS.taper_slope, description="lost a length by the wall nearest to the axis")
    # the cross, by the paper's own numbers
    half_width_m: float = _CROSS.half_width_m
    half_length_m: float = _CROSS.half_length_m
    apex_m: float = _CROSS.apex_m
    tip_half_width_m: float = _CROSS.tip_half_width_m
    # every other section
    radius_m: float | None = Field(default=None, gt=0.0, description="of the farthest corner, or of a round")
    inner_radius_m: float | None = Field(default=None, gt=0.0, description="star, spline, keyway")
    tooth_half_width_m: float | None = Field(default=None, gt=0.0, description="of a spline's tooth, or of the key")
    count: int | None = Field(default=None, ge=2, le=24, description="a star's points, a spline's teeth")
    taper_start_m: float = _CROSS.taper_start_m
    tip_m: float = _CROSS.tip_m
    tip_scale: float | None = Field(default=None, gt=0.0, lt=1.0, description="the tip as a share of the body")

    @model_validator(mode="after")
    def _can_be_made(self) -> PegDrawing:
        for name in self._without_meaning():
            if getattr(self, name) != type(self).model_fields[name].default:
                raise ValueError(f"{name} means nothing for the outline {self.outline!r}; leave it out")
        self.shape()
        return self

    def _without_meaning(self) -> tuple[str, ...]:
        if self.corners_m is not None or self.outline not in OUTLINES:
            return (*_CROSS_ONLY, *_SIZES)
        if self.outline == CROSS:
            return (*_BUT_CROSS, *_SIZES)
        return (*_CROSS_ONLY, *(name for name in _SIZES if name not in _SIZES_OF[self.outline]))

    def shape(self) -> Peg:
        """The shape that simulator, vision and mechanics share. ValueError if the numbers give no valid shape."""
        return _peg(self)


# bounds of the tolerance: below, vision would take its own noise for another part; above, it would accept any part
MIN_TOLERANCE_M, MAX_TOLERANCE_M = 1e-6, 5e-4


class HoleTolerance(Section):
    """How far the hole that was made may be from its drawing, one standard deviation each: of a tolerance of plus or
    minus t write t / 2.

    Vision measures the hole within this tolerance; a larger one gives the pose a larger covariance. A hole that is
    clearly farther off counts as another part (the refusal `not_the_drawing`).
    """

    size_m: float = Field(default=0.03e-3, description="the outline too large or too small, on every side")
    edge_break_m: float = Field(
        default=0.06e-3, description="each of the chamfer's two lines by itself: broken edges, burrs"
    )
    chamfer_m: float = Field(
        default=0.0, description="the chamfer's width beside that: it moves the line where face and chamfer meet"
    )

    @field_validator("*")
    @classmethod
    def _of_a_machined_part(cls, value: float, info: ValidationInfo) -> float:
        least = 0.0 if info.field_name == "chamfer_m" else MIN_TOLERANCE_M
        if not least <= value <= MAX_TOLERANCE_M:
            raise ValueError(
                f"wants one standard deviation in metres, {least:g} to {MAX_TOLERANCE_M:g}; of +-0.1 mm write 0.00005"
            )
        return value


class HoleDrawing(Section):
    """The hole's drawing: the peg's section and a clearance on every side, and how exactly it was made."""

    clearance_m: float = Field(default=0.0001, gt=0.0, le=0.002)
    chamfer_m: float = Field(default=0.001, ge=0.0, le=0.01)
    tolerance: HoleTolerance = HoleTolerance()

    def shape(self, peg: Peg) -> Hole:
        """The hole around a peg."""
        return _hole(peg, self.clearance_m, self.chamfer_m)


def peg_section(peg: str) -> dict[str, Any]:
    """The section `cell.peg` of a cell's file for a peg given by its name, or by the SVG or DXF file of its outline.

    The outline's corners are written out, so that no other machine needs the file. Raises ConfigError.
    """
    try:
        if Path(peg).suffix.lower() not in FILE_SUFFIXES:
            return {"outline": PegDrawing(outline=peg).outline}
        return drawn_section(read_drawing(Path(peg)))
    except ValidationError as error:
        raise ConfigError(f"--peg: {error.errors()[0]['msg'].removeprefix('Value error, ')}") from None
    except ValueError as error:
        raise ConfigError(f"--peg: {error}") from None


def drawn_section(drawing: DrawingRead) -> dict[str, Any]:
    """The section `cell.peg` with the corners of a drawing. Raises DrawingRefused if the drawing gives no polygon."""
    outline = drawing.outline()
    corners = [[round(float(value), 9) for value in corner] for corner in outline.corners_m]
    return {"outline": outline.name, "corners_m": corners}


@lru_cache(maxsize=64)
def _peg(drawing: PegDrawing) -> Peg:
    if drawing.outline == CROSS and drawing.corners_m is None:
        return CrossPeg(
            half_width_m=drawing.half_width_m,
            half_length_m=drawing.half_length_m,
            body_start_m=drawing.body_start_m,
            taper_slope=drawing.taper_slope,
            apex_m=drawing.apex_m,
            tip_half_width_m=drawing.tip_half_width_m,
        )
    outline = _outline(drawing)
    if outline.inner_radius_m < MIN_INNER_RADIUS_M:
        raise ValueError(
            f"outline {outline.name}: its nearest wall is {outline.inner_radius_m * 1e3:.3f} mm from the axis, a "
            f"peg wants {MIN_INNER_RADIUS_M * 1e3:g} mm or more; draw it larger, or mend the drawing's unit"
        )
    scale = drawing.tip_scale
    if scale is None:
        scale = tip_scale_of(outline, drawing.taper_slope, drawing.tip_m - drawing.taper_start_m)
    return tapered(outline, drawing.body_start_m, drawing.taper_start_m, drawing.tip_m, scale)


def _outline(drawing: PegDrawing) -> Outline:
    if drawing.corners_m is not None:
        return Outline.of(drawing.outline, drawing.corners_m)
    if drawing.outline in NAMED:
        return NAMED[drawing.outline](
            Sizes(drawing.radius_m, drawing.inner_radius_m, drawing.tooth_half_width_m, drawing.count)
        )
    if Path(drawing.outline).suffix.lower() in FILE_SUFFIXES:
        return outline_from_file(Path(drawing.outline))
    meant = did_you_mean(drawing.outline, OUTLINES)
    raise ValueError(
        f"outline {drawing.outline!r}: want one of {', '.join(OUTLINES)}, or a file that ends in "
        f"{' or '.join(FILE_SUFFIXES)}" + (f": {meant}" if meant else "")
    )


@lru_cache(maxsize=64)
def _hole(peg: Peg, clearance_m: float, chamfer_m: float) -> Hole:
    return peg.hole(clearance_m, chamfer_m)
