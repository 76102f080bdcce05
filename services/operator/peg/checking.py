"""Whether a drawing can be a peg and a hole: read, cut into chords, made into the solids that the cell would use."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from crosspih_common.config.drawing import HoleDrawing, PegDrawing, drawn_section
from crosspih_common.shapes import Peg
from crosspih_common.shapes.importing import DrawingRead, read_drawing


class PegReport(BaseModel):
    """What `crosspih peg check --json` prints. A figure is null where the reading of the drawing did not
    get that far.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    area_mm2: float | None = Field(default=None, description="that the contour encloses")
    width_mm: float | None = Field(default=None, description="of the contour, along x")
    height_mm: float | None = Field(default=None, description="of the contour, along y")
    corners: int | None = Field(default=None, description="of the contour; chords of a curve have none between them")
    symmetry: int | None = Field(default=None, description="turns that look the same; 0 for a round")
    left_out: list[str] = Field(default_factory=list, description="parts of the file that are not part of the outline")
    refusal: str | None = Field(default=None, description="why it cannot be a peg and a hole, and the mend")


@dataclass(frozen=True, slots=True, eq=False)
class Checked:
    """The report with the data behind it, as far as the check got."""

    report: PegReport
    drawing: DrawingRead | None = None
    peg: Peg | None = None


def check(path: Path, hole: HoleDrawing) -> Checked:
    """Read a drawing and make its peg, and its hole with that clearance and chamfer."""
    try:
        drawing = read_drawing(path)
    except ValueError as error:
        return Checked(PegReport(refusal=_one_line(error)))
    contour = drawing.contour
    figures: dict[str, Any] = {
        "area_mm2": round(contour.area_m2 * 1e6, 3), "width_mm": round(contour.width_m * 1e3, 3),
        "height_mm": round(contour.height_m * 1e3, 3), "corners": contour.corners, "symmetry": contour.symmetry,
        "left_out": list(drawing.left_out),
    }  # fmt: skip
    peg: Peg | None = None
    try:
        peg = PegDrawing.model_validate(drawn_section(drawing)).shape()
        peg.pieces()
        hole.shape(peg).pieces()
    except ValueError as error:
        said = _one_line(error)
        if not said.startswith(str(path)):
            said = f"{path}: {said}"
        return Checked(PegReport(**figures, refusal=said), drawing, peg)
    return Checked(PegReport(**figures), drawing, peg)


def _one_line(error: ValueError) -> str:
    if isinstance(error, ValidationError):
        return str(error.errors()[0]["msg"]).removeprefix("Value error, ")
    return " ".join(str(error).split())
