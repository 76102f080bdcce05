"""The curves in the model space of a DXF file; blocks are inserted, and hidden layers are left out."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from shapely import LinearRing

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.drawn.curves import FINE_M, JOINED_M, MAX_BYTES, Curve, DrawingRefused, Sheet

_CURVES = frozenset(["LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE", "SOLID", "TRACE"])
_FILLINGS = frozenset(["HATCH", "MPOLYGON"])
_NO_OUTLINE = {
    **dict.fromkeys(["TEXT", "MTEXT", "ATTDEF", "ATTRIB", "RTEXT", "ARCALIGNEDTEXT"], "a text"),
    **dict.fromkeys(["DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION", "TOLERANCE"], "a dimension"),
    **dict.fromkeys(["LEADER", "MULTILEADER", "MLEADER"], "a leader"),
    "POINT": "a point", "VIEWPORT": "a viewport", "ACAD_TABLE": "a table",
}  # fmt: skip
_DEEPEST = 16
_MAX_ENTITIES = 10_000
_MAX_POLES = 5_000
EXTRA = "install it with `pip install 'crosspih[shapes]'`"


@dataclass(frozen=True, slots=True)
class _Block:
    """The state inside a block: its matrix, the layer that layer 0 stands for, and the enclosing blocks."""

    matrix: Any = None
    layer: str = ""
    above: tuple[str, ...] = ()

    @property
    def inside(self) -> str:
        return f" in the block {self.above[-1]!r}" if self.above else ""


def dxf_sheet(path: Path) -> Sheet:
    """The curves of a file. DrawingRefused names the entity and the mend."""
    try:
        from ezdxf import units
        from ezdxf.enums import InsertUnits
        from ezdxf.filemanagement import readfile
        from ezdxf.lldxf.const import DXFError
    except ImportError:
        raise DrawingRefused(f"reading DXF wants ezdxf; {EXTRA}") from None
    _look_at_size(path)
    try:
        document = readfile(path)
    except (OSError, DXFError, UnicodeError, ValueError, IndexError, KeyError, AttributeError, TypeError) as error:
        raise DrawingRefused(f"is no DXF: {error}") from None
    try:
        unit = InsertUnits(document.units)
        metres = float(units.conversion_factor(unit, InsertUnits.Meters)) if document.units else 0.0
    except (ValueError, TypeError, KeyError):
        raise DrawingRefused(f"its unit of length is not known ($INSUNITS is {document.units})") from None
    if not metres > 0.0:
        raise DrawingRefused("has no unit of length ($INSUNITS is 0); set it, to 4 for millimetres")
    sheet = Sheet(y_down=False)
    walk = _Walk(document, sheet, metres)
    walk.space(document.modelspace(), _Block())
    walk.finish()
    for layout in document.layouts:
        if layout.name != "Model":
            rest = [entity for entity in layout if entity.dxftype() not in _NO_OUTLINE]
            if rest:
                sheet.left_out.append(f"layout {layout.name!r}: {len(rest)} entities, paper and not model")
    return sheet


def _look_at_size(path: Path) -> None:
    if path.stat().st_size > MAX_BYTES:
        raise DrawingRefused(f"has more than {MAX_BYTES // 1_000_000} MB; simplify the drawing")
    content = path.read_bytes()
    # a group of code 0 begins each entity, and each vertex of an old polyline
    entities = len(re.findall(rb"\n[ \t]*0\r?\n", content))
    if entities > _MAX_ENTITIES:
        raise DrawingRefused(
            f"holds {entities} entities and vertices, more than {_MAX_ENTITIES}; leave the peg's outline alone, or "
            f"make it one LWPOLYLINE"
        )


class _Walk:
    """Through the entities of one file."""

    def __init__(self, document: Any, sheet: Sheet, metres: float) -> None:
        self._document, self._sheet, self._metres = document, sheet, metres
        self._fillings: list[Curve] = []

    def space(self, entities: Any, block: _Block) -> None:
        """All entities of the model or of a block."""
        for entity in entities:
            self._entity(entity, block)

    def finish(self) -> None:
        """Drop a fill whose outline is drawn as well; otherwise its border is used as the outline."""
        for filling in self._fillings:
            ring = LinearRing(filling.points_m)
            if self._sheet.curves and any(_on(ring, curve.points_m) for curve in self._sheet.curves):
                self._sheet.left_out.append(f"{filling.entity}: fills an outline that is drawn")
            else:
                self._sheet.draw(filling.entity, filling.points_m)

    def _entity(self, entity: Any, block: _Block) -> None:
        kind = entity.dxftype()
        layer = entity.dxf.get("layer", "0")
        if layer == "0" and block.layer:
            layer = block.layer
        name = f"{kind} {entity.dxf.handle} on layer {layer}{block.inside}"
        self._sheet.count(name)
        hidden = self._hidden(entity, layer, kind)
        if hidden is not None:
            self._sheet.left_out.append(f"{name}: {hidden}")
        elif kind == "INSERT":
            self._insert(entity, layer, name, block)
        elif kind in _CURVES:
            self._draw(entity, kind, name, block)
        elif kind in _FILLINGS:
            self._filling(entity, name, block)
        elif kind in _NO_OUTLINE:
            self._sheet.left_out.append(f"{name}: {_NO_OUTLINE[kind]}")
        else:
            raise DrawingRefused(f"{name} is not understood as part of an outline; remove it, or switch its layer off")

    def _hidden(self, entity: Any, layer: str, kind: str) -> str | None:
        if entity.dxf.get("invisible", 0):
            return "invisible"
        if layer.lower() == "defpoints":
            return "its layer is not plotted"
        if not self._document.layers.has_entry(layer):
            return None
        found = self._document.layers.get(layer)
        if found.is_frozen():
            return "its layer is frozen"
        # what a block draws on layers of its own is seen when the INSERT's layer is off
        if found.is_off() and kind != "INSERT":
            return "its layer is off"
        return "its layer is not plotted" if not found.dxf.get("plot", 1) and kind != "INSERT" else None

    def _insert(self, entity: Any, layer: str, name: str, block: _Block) -> None:
        said = entity.dxf.name
        if said in block.above:
            raise DrawingRefused(f"{name}: the block {said!r} holds itself; explode it")
        if len(block.above) >= _DEEPEST:
            raise DrawingRefused(f"{name}: blocks in blocks, more than {_DEEPEST} deep; explode them")
        definition = self._document.blocks.get(said)
        if definition is None:
            raise DrawingRefused(f"{name}: there is no block {said!r} in this file; insert what it should be")
        if definition.block is not None and definition.block.is_xref:
            raise DrawingRefused(f"{name}: the block {said!r} is in another file; bind it into this one")
        copies = int(entity.dxf.get("column_count", 1)) * int(entity.dxf.get("row_count", 1))
        for _ in range(min(copies, 10)):
            self._sheet.count(name)
        if copies > 100:
            raise DrawingRefused(f"{name}: an array of {copies}; leave the one outline of the peg")
        for one in entity.multi_insert() if copies > 1 else (entity,):
            matrix = one.matrix44()
            inner = _Block(matrix if block.matrix is None else matrix @ block.matrix, layer, (*block.above, said))
            self.space(definition, inner)
        for attribute in entity.attribs:
            self._entity(attribute, block)

    def _draw(self, entity: Any, kind: str, name: str, block: _Block) -> None:
        from ezdxf import path as dxf_path

        if kind == "POLYLINE" and (entity.is_poly_face_mesh or entity.is_polygon_mesh):
            raise DrawingRefused(f"{name} is a mesh; draw the outline as a closed polyline")
        if kind == "POLYLINE" and entity.dxf.get("flags", 0) & 4:
            raise DrawingRefused(f"{name} is a spline fitted to a polyline; make it a SPLINE, or explode it")
        fine = self._fine(block)
        if kind == "SPLINE" and len(entity.control_points) + len(entity.fit_points) > _MAX_POLES:
            raise DrawingRefused(f"{name} has more than {_MAX_POLES} points; simplify it")
        try:
            if kind == "LWPOLYLINE" and not entity.has_arc:
                points = _straight(entity)
            elif kind in ("ARC", "CIRCLE", "ELLIPSE", "SPLINE"):
                points = [tuple(vertex) for vertex in entity.flattening(fine)]
            elif kind in ("LWPOLYLINE", "POLYLINE") and entity.has_arc:
                points = _with_arcs(entity, fine)
            else:
                points = [tuple(vertex) for vertex in dxf_path.make_path(entity).flattening(fine, segments=1)]
        except (TypeError, ValueError, ArithmeticError, AttributeError, IndexError) as error:
            raise DrawingRefused(f"{name} cannot be read ({error}); draw it anew") from None
        self._sheet.draw(name, self._placed(points, name, block))

    def _filling(self, entity: Any, name: str, block: _Block) -> None:
        from ezdxf import path as dxf_path

        try:
            borders = list(dxf_path.from_hatch(entity))
        except (TypeError, ValueError, ArithmeticError, AttributeError, IndexError) as error:
            raise DrawingRefused(f"{name} cannot be read ({error}); draw its border instead") from None
        for border in borders:
            flat = [tuple(vertex) for vertex in border.flattening(self._fine(block), segments=4)]
            points = self._placed(flat, name, block)
            if len(points) > 3:
                self._fillings.append(Curve(name, np.vstack([points, points[:1]])))

    def _fine(self, block: _Block) -> float:
        """How far chords may be off, in the units of the entity."""
        if block.matrix is None:
            return FINE_M / self._metres
        axes = np.array([tuple(block.matrix.transform_direction(axis)) for axis in np.eye(3).tolist()])
        return FINE_M / self._metres / max(float(np.linalg.norm(axes, 2)), 1e-9)

    def _placed(self, vertices: list[tuple[float, ...]], name: str, block: _Block) -> Array:
        """Vertices (n, 3) of an entity as points (n, 2) in the model, m."""
        if not vertices:
            return np.zeros((0, 2))
        if block.matrix is not None:
            vertices = [tuple(vertex) for vertex in block.matrix.transform_vertices(vertices)]
        points = np.array(vertices, dtype=float) * self._metres
        if not np.all(np.isfinite(points)):
            raise DrawingRefused(f"{name} has coordinates that are no numbers; draw it anew")
        if float(np.ptp(points[:, 2])) > JOINED_M:
            raise DrawingRefused(f"{name} leaves the plane of the drawing; draw the outline flat, in x and y")
        return np.asarray(points[:, :2])


def _straight(entity: Any) -> list[tuple[float, ...]]:
    """The vertices (n, 3) of a polyline without bulges; of a closed one the first again."""
    flat = np.array(entity.lwpoints.values, dtype=float).reshape(-1, 5)[:, :2]
    if entity.closed and len(flat):
        flat = np.vstack([flat, flat[:1]])
    vertices = np.column_stack([flat, np.full(len(flat), float(entity.dxf.elevation))])
    if tuple(entity.dxf.extrusion) != (0.0, 0.0, 1.0):
        return [tuple(vertex) for vertex in entity.ocs().points_to_wcs(vertices.tolist())]
    return [tuple(row) for row in vertices.tolist()]


def _with_arcs(entity: Any, fine: float) -> list[tuple[float, ...]]:
    """The vertices (n, 3) of a polyline with bulges: its lines and arcs one after the other."""
    points: list[tuple[float, ...]] = []
    for part in entity.virtual_entities():
        if part.dxftype() == "LINE":
            piece = [tuple(part.dxf.start), tuple(part.dxf.end)]
        else:
            piece = [tuple(vertex) for vertex in part.flattening(fine)]
        if points and np.hypot(*np.subtract(piece[-1], points[-1])[:2]) < np.hypot(
            *np.subtract(piece[0], points[-1])[:2]
        ):
            piece.reverse()
        elif not points:
            start = tuple(next(iter(entity.vertices_in_wcs()))) if hasattr(entity, "vertices_in_wcs") else piece[0]
            if np.hypot(*np.subtract(piece[-1], start)[:2]) < np.hypot(*np.subtract(piece[0], start)[:2]):
                piece.reverse()
        points += piece if not points else piece[1:]
    return points


def _on(ring: LinearRing, points: Array) -> bool:
    from shapely import points as shapely_points

    return float(np.max(ring.distance(shapely_points(points)))) < 2.0 * JOINED_M
