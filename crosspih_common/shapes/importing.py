"""An outline from a drawing file: the one closed curve in an SVG or DXF.

x is to the right and y up as the drawing is seen, looking at the peg's tip. Lengths must have a unit in the file: an
SVG's width and height (say "60mm"), a DXF's $INSUNITS. The area's centroid is put on the peg's axis, or, where it does
not see the whole outline, the place that does. Curves become chords, which leave them by the least of `TOLERANCES_M`
that makes no more than `MOST_CORNERS` corners: peg and hole get the same chords, so that this changes the shape but not
the fit. The readers are imported when a file is read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.optimize import linprog
from shapely import Polygon
from shapely.validation import explain_validity

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.outline import Outline

FILE_SUFFIXES = (".svg", ".dxf")
TOLERANCES_M = (5e-5, 1e-4, 2e-4)
MOST_CORNERS = 64
JOINED_M = 1e-5
MM_A_PIXEL = 25.4 / 96.0
EXTRA = "install it with `pip install 'crosspih[shapes]'`"
UNITS = ("mm", "cm", "in", "pt", "pc")


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A flattened curve of a file: what it is called there, and its points (n, 2), m."""

    entity: str
    points_m: Array

    @property
    def gap_m(self) -> float:
        """From its end to its start."""
        return float(np.hypot(*(self.points_m[-1] - self.points_m[0])))


def outline_from_file(path: Path) -> Outline:
    """The one closed outline in a file, centred on the axis. ValueError names the file, the entity, the mend."""
    if not path.is_file():
        raise ValueError(f"{path}: there is no such drawing; name an SVG or DXF file")
    read = _svg_curves if path.suffix.lower() == ".svg" else _dxf_curves
    for tolerance_m in TOLERANCES_M:
        curve = _only_one(path, read(path, tolerance_m))
        corners = _corners(path, curve)
        if len(corners) <= MOST_CORNERS:
            break
    else:
        raise ValueError(
            f"{path}: {curve.entity} has {len(corners)} corners once its curves are chords, more than {MOST_CORNERS}; "
            f"simplify it"
        )
    try:
        return Outline.of(path.stem, corners)
    except ValueError as error:
        raise ValueError(f"{path}: {curve.entity}: {error}") from None


def _only_one(path: Path, curves: list[Curve]) -> Curve:
    if not curves:
        raise ValueError(f"{path}: holds no curve; draw the peg's outline as one closed curve")
    for curve in curves:
        if curve.gap_m > JOINED_M:
            raise ValueError(f"{path}: {curve.entity} is open: its ends are {curve.gap_m * 1e3:.3f} mm apart; close it")
    if len(curves) > 1:
        names = ", ".join(curve.entity for curve in curves)
        raise ValueError(f"{path}: holds {len(curves)} outlines ({names}); leave the peg's own, without holes")
    return curves[0]


def _corners(path: Path, curve: Curve) -> Array:
    """(n, 2), about the peg's axis."""
    where = f"{path}: {curve.entity}"
    distinct = curve.points_m[np.hypot(*np.diff(curve.points_m, axis=0, append=curve.points_m[:1]).T) > 1e-7]
    if len(distinct) < 3:
        raise ValueError(f"{where} encloses no area; draw the peg's outline as one closed curve")
    polygon = Polygon(distinct)
    if not polygon.is_valid:
        raise ValueError(f"{where}: {explain_validity(polygon)} (m); the outline may not cross or touch itself")
    # corners on a straight line add nothing
    corners = np.array(polygon.simplify(1e-7).exterior.coords[:-1])
    return corners - _axis(corners, np.array([polygon.centroid.x, polygon.centroid.y]))


def _axis(corners: Array, centroid: Array) -> Array:
    """Where the peg's axis goes (2,): the centroid where it sees the whole outline, else the place that does and is
    farthest behind the lines of all edges; where there is none the centroid, for the peg to say what is wrong."""
    x, y = (np.roll(corners, -1, axis=0) - corners).T
    turn = np.sign(np.sum(corners[:, 0] * np.roll(corners[:, 1], -1) - np.roll(corners[:, 0], -1) * corners[:, 1]))
    normals = turn * np.column_stack([y, -x]) / np.hypot(x, y)[:, None]
    offsets = np.sum(normals * corners, axis=1)
    if np.all(normals @ centroid <= offsets):
        return centroid
    farthest = linprog(
        [0.0, 0.0, -1.0],
        A_ub=np.column_stack([normals, np.ones(len(normals))]),
        b_ub=offsets,
        bounds=[(None, None)] * 2 + [(0.0, None)],
    )
    return centroid if farthest.x is None else np.asarray(farthest.x[:2])


def _flattened(point_at: Callable[[float], Array], tolerance_m: float, pieces: int = 4) -> Array:
    """Points (n, 2) on a curve over 0..1, the chords between them no farther off than a tolerance; the last left out.

    A chord is halved as long as the curve leaves it, so that equal arcs are cut alike.
    """

    def between(start: float, end: float, depth: int) -> list[Array]:
        first, last = point_at(start), point_at(end)
        chord = last - first
        length = float(np.hypot(*chord))
        off_m = 0.0
        for share in (0.25, 0.5, 0.75):
            way = point_at(start + share * (end - start)) - first
            off_m = max(off_m, abs(float(chord[0] * way[1] - chord[1] * way[0])) / length if length else np.hypot(*way))
        if off_m <= tolerance_m or depth == 0:
            return [first]
        middle = (start + end) / 2.0
        return between(start, middle, depth - 1) + between(middle, end, depth - 1)

    steps = np.linspace(0.0, 1.0, pieces + 1)
    return np.array([point for start, end in pairwise(steps) for point in between(start, end, 8)])


# ------------------------------------------------------------------------------------------------------------------ SVG


def _svg_curves(path: Path, tolerance_m: float) -> list[Curve]:
    try:
        import svgelements
    except ImportError:
        raise ValueError(f"{path}: reading SVG wants svgelements; {EXTRA}") from None
    try:
        root = ElementTree.parse(path).getroot()
        drawing = svgelements.SVG.parse(str(path))
    except (ElementTree.ParseError, ValueError) as error:
        raise ValueError(f"{path}: is no SVG: {error}") from None
    for side in ("width", "height"):
        if not root.get(side, "").strip().endswith(UNITS):
            raise ValueError(
                f'{path}: svg: {side} has no unit of length (got {root.get(side)!r}); write it as {side}="60mm" with '
                f"a viewBox"
            )
    curves: list[Curve] = []
    for number, element in enumerate(drawing.elements(lambda element: isinstance(element, svgelements.Shape))):
        if element.values.get("visibility") == "hidden":
            continue
        kind = element.values.get("tag") or type(element).__name__.lower()
        name = f"{kind} {element.id!r}" if element.id else f"{kind} number {number + 1}"
        whole = svgelements.Path(element)
        whole.reify()
        for part in whole.as_subpaths():
            points = _svg_points(svgelements.Path(part), tolerance_m * 1e3 / MM_A_PIXEL)
            if len(points) > 1:
                curves.append(Curve(name, points * [MM_A_PIXEL * 1e-3, -MM_A_PIXEL * 1e-3]))
    return curves


def _svg_points(part: Any, tolerance_px: float) -> Array:
    """The points (n, 2) of one subpath, pixels."""
    points: list[Array] = []
    last: Array | None = None
    for segment in part:
        kind = type(segment).__name__
        if kind == "Move":
            continue
        straight = kind in ("Line", "Close")
        if segment.start is None or segment.end is None:
            continue

        def at(share: float, segment: Any = segment) -> Array:
            place = segment.point(share)
            return np.array([float(place.x), float(place.y)])

        points.append(at(0.0)[None] if straight else _flattened(at, tolerance_px))
        last = at(1.0)
    return np.vstack([*points, last[None]]) if last is not None else np.zeros((0, 2))


# ------------------------------------------------------------------------------------------------------------------ DXF


def _dxf_curves(path: Path, tolerance_m: float) -> list[Curve]:
    try:
        from ezdxf import path as dxf_path
        from ezdxf import units
        from ezdxf.enums import InsertUnits
        from ezdxf.filemanagement import readfile
        from ezdxf.lldxf.const import DXFError
    except ImportError:
        raise ValueError(f"{path}: reading DXF wants ezdxf; {EXTRA}") from None
    try:
        document = readfile(path)
    except (OSError, DXFError) as error:
        raise ValueError(f"{path}: is no DXF: {error}") from None
    if not document.units:
        raise ValueError(f"{path}: has no unit of length ($INSUNITS is 0); set it, to 4 for millimetres")
    metres = float(units.conversion_factor(InsertUnits(document.units), InsertUnits.Meters))
    curves: list[Curve] = []
    for entity in document.modelspace():
        name = f"{entity.dxftype()} {entity.dxf.handle} on layer {entity.dxf.layer}"
        try:
            drawn = dxf_path.make_path(entity)
        except TypeError:
            continue  # a text or a dimension is not part of the outline
        points = np.array([[v.x, v.y] for v in drawn.flattening(tolerance_m / metres)]) * metres
        if entity.dxftype() == "CIRCLE":
            points = _circle(points, tolerance_m)
        if len(points) > 1:
            curves.append(Curve(name, points))
    return _joined(curves)


def _circle(points: Array, tolerance_m: float) -> Array:
    """A circle (n, 2) cut into equal chords, as many as a circle of an SVG gets."""
    centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
    radius_m = float(np.ptp(points[:, 0])) / 2.0

    def at(share: float) -> Array:
        return np.asarray(centre + radius_m * np.array([np.cos(2.0 * np.pi * share), np.sin(2.0 * np.pi * share)]))

    return np.asarray(np.vstack([_flattened(at, tolerance_m, pieces=16), at(0.0)[None]]))


def _joined(curves: list[Curve]) -> list[Curve]:
    """Lines and arcs that follow each other end to end, joined; a curve that nothing follows is left open."""
    done = [curve for curve in curves if curve.gap_m <= JOINED_M and len(curve.points_m) > 3]
    rest = [curve for curve in curves if curve not in done]
    while rest:
        chain = rest.pop(0)
        while chain.gap_m > JOINED_M:
            following = _following(chain, rest)
            if following is None:
                break
            index, points = following
            rest.pop(index)
            chain = Curve(chain.entity, np.vstack([chain.points_m, points[1:]]))
        done.append(chain)
    return done


def _following(chain: Curve, rest: list[Curve]) -> tuple[int, Array] | None:
    for index, other in enumerate(rest):
        for points in (other.points_m, other.points_m[::-1]):
            if float(np.hypot(*(points[0] - chain.points_m[-1]))) <= JOINED_M:
                return index, points
    return None
