"""An outline from a drawing file: the one closed curve in an SVG or DXF.

x is to the right and y up as the drawing is seen, looking at the peg's tip. Lengths must have a unit in the file: an
SVG's width and height (say "60mm"), a DXF's $INSUNITS. The area's centroid is put on the peg's axis, or, where it does
not see the whole outline, the place that does. Curves become chords, which leave them by the least of `TOLERANCES_M`
that makes no more than `MAX_CORNERS` corners: peg and hole get the same chords, so that this changes the shape but not
the fit. The readers are imported when a file is read.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.drawn.contour import Contour, contour_of
from crosspih_common.shapes.drawn.curves import DrawingRefused
from crosspih_common.shapes.outline import Outline

FILE_SUFFIXES = (".svg", ".dxf")
TOLERANCES_M = (5e-5, 1e-4, 2e-4)
MAX_CORNERS = 64


@dataclass(frozen=True, slots=True, eq=False)
class DrawingRead:
    """A file's contour: what the outline is called there, and by name what the file shows and is no part of it."""

    path: Path
    entity: str
    contour: Contour
    left_out: tuple[str, ...]

    def outline(self) -> Outline:
        """The peg's polygon about its axis. DrawingRefused where there is none."""
        for tolerance_m in TOLERANCES_M:
            corners = self.contour.chords(tolerance_m)
            if len(corners) <= MAX_CORNERS:
                break
        else:
            raise DrawingRefused(
                f"{self.path}: {self.entity} has {len(corners)} corners once its curves are chords, more than "
                f"{MAX_CORNERS}; simplify it"
            )
        try:
            return Outline.of(self.path.stem, corners - _axis(corners))
        except ValueError as error:
            raise DrawingRefused(f"{self.path}: {self.entity}: {error}") from None


def read_drawing(path: Path) -> DrawingRead:
    """The one closed contour of a file. DrawingRefused, a ValueError, names the file, the entity and the mend."""
    if not path.is_file():
        raise DrawingRefused(f"{path}: there is no such drawing; name an SVG or DXF file")
    from crosspih_common.shapes.drawn.joining import only_closed_curve

    try:
        if path.suffix.lower() == ".svg":
            from crosspih_common.shapes.drawn.svg import svg_sheet

            sheet = svg_sheet(path)
        elif path.suffix.lower() == ".dxf":
            from crosspih_common.shapes.drawn.dxf import dxf_sheet

            sheet = dxf_sheet(path)
        else:
            raise DrawingRefused(f"is neither {' nor '.join(FILE_SUFFIXES)} by its name")
        curve = only_closed_curve(sheet)
        contour = contour_of(curve.entity, curve.points_m)
    except DrawingRefused as error:
        raise DrawingRefused(f"{path}: {error}") from None
    except OSError as error:
        raise DrawingRefused(f"{path}: cannot be read ({error.strerror})") from None
    return DrawingRead(path, curve.entity, contour, tuple(sheet.left_out))


def outline_from_file(path: Path) -> Outline:
    """The one closed outline in a file, centred on the axis. ValueError names the file, the entity, the mend."""
    return read_drawing(path).outline()


def _axis(corners: Array) -> Array:
    """Where the peg's axis goes (2,), from the centroid: there, where it sees the whole outline, else the place that
    does and is farthest behind the lines of all edges; where there is none the centroid, for the peg to say what is
    wrong."""
    x, y = (np.roll(corners, -1, axis=0) - corners).T
    normals = np.column_stack([y, -x]) / np.hypot(x, y)[:, None]
    offsets = np.sum(normals * corners, axis=1)
    if np.all(offsets >= 0.0):
        return np.zeros(2)
    from scipy.optimize import linprog  # a quarter of a second to load, and few drawings want it

    farthest = linprog(
        [0.0, 0.0, -1.0],
        A_ub=np.column_stack([normals, np.ones(len(normals))]),
        b_ub=offsets,
        bounds=[(None, None)] * 2 + [(0.0, None)],
    )
    return np.zeros(2) if farthest.x is None else np.asarray(farthest.x[:2])
