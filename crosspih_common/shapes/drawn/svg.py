"""The curves of an SVG file, mm on its page; all transforms, scales and visibility rules are applied."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from shapely import Geometry, LineString, Polygon, union_all

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.drawn.curves import FINE_M, DrawingRefused, Sheet
from crosspih_common.shapes.drawn.svg_document import Document, local_name, read_document
from crosspih_common.shapes.drawn.svg_lengths import (
    PX_MM,
    Viewport,
    fitted,
    matrix_of,
    physical_mm,
    shifted,
    user_units,
    view_box,
)
from crosspih_common.shapes.drawn.svg_paths import numbers, subpaths
from crosspih_common.shapes.drawn.svg_styles import is_none, markers, style_of, unpainted

SHAPES = ("path", "rect", "circle", "ellipse", "line", "polyline", "polygon")
_GROUPS = ("svg", "g", "a")
_NEVER_DRAWN = frozenset([
    "defs", "symbol", "clippath", "mask", "marker", "pattern", "lineargradient", "radialgradient", "meshgradient",
    "filter", "title", "desc", "metadata", "style", "view", "cursor", "color-profile", "font", "font-face", "stop",
    "hatch", "solidcolor", "namedview",
])  # fmt: skip
_WRITTEN = frozenset(["text", "flowroot", "textpath", "tspan", "tref"])
_DEEPEST = 60
_CLIP_SLACK_MM = 1e-2


@dataclass(frozen=True, slots=True)
class _Place:
    """The state of the walk: matrix (3, 3) from user units to mm on the page, inherited style, and clipping."""

    matrix: Array
    style: dict[str, str]
    viewport: Viewport
    clips: tuple[tuple[str, Geometry], ...] = ()
    inside: str = ""
    depth: int = 0
    used: tuple[str, ...] = ()


def svg_sheet(path: Path) -> Sheet:
    """The curves of a file. DrawingRefused names the element and the mend."""
    document = read_document(path)
    root, sheet = document.root, Sheet(y_down=True)
    width, height = (physical_mm(name, root.get(name)) for name in ("width", "height"))
    seen = view_box("svg", root.get("viewBox"))
    if seen is None:
        matrix, viewport = np.diag([PX_MM, PX_MM, 1.0]), Viewport(width / PX_MM, height / PX_MM)
    else:
        matrix = fitted("svg", seen, width, height, root.get("preserveAspectRatio"))
        viewport = Viewport(seen[2], seen[3])
    walk = _Walk(document, sheet)
    start = _Place(matrix, {}, viewport)
    inner = walk.entered(root, "svg", "svg", start)
    if inner is not None:
        for child in root:
            walk.element(child, inner)
    return sheet


class _Walk:
    """Down the elements of one file."""

    def __init__(self, document: Document, sheet: Sheet) -> None:
        self._document, self._sheet = document, sheet
        self._shapes = 0

    def element(self, element: Element, place: _Place) -> None:
        """One element with all in it."""
        tag = local_name(element)
        if tag is None or tag.lower() in _NEVER_DRAWN:
            return
        name = self._name(element, tag) + place.inside
        self._sheet.count(name)
        if place.depth > _DEEPEST:
            raise DrawingRefused(
                f"{name} lies more than {_DEEPEST} elements deep; draw the outline without so many groups"
            )
        if tag.lower() in _WRITTEN:
            self._sheet.left_out.append(f"{name}: a text")
            return
        if tag not in SHAPES and tag not in _GROUPS and tag != "use":
            raise DrawingRefused(f"{name} is not understood as part of an outline; remove it")
        inner = self.entered(element, tag, name, place)
        if inner is None:
            return
        if tag in SHAPES:
            self._shape(element, tag, name, inner)
        elif tag == "use":
            self._use(element, name, inner)
        else:
            if tag == "svg":
                size = tuple(
                    self._length(element, name, key, inner, axis, 0.0) for key, axis in (("x", "x"), ("y", "y"))
                )
                moved = replace(inner, matrix=inner.matrix @ shifted(*size))
                inner = self._viewport(element, element, name, moved)
            for child in element:
                self.element(child, inner)

    def entered(self, element: Element, tag: str, name: str, place: _Place) -> _Place | None:
        """The place within an element; None where nothing in it is seen."""
        for attribute in ("transform-origin", "requiredFeatures", "requiredExtensions", "systemLanguage"):
            if element.get(attribute) is not None:
                raise DrawingRefused(
                    f"{name}: {attribute} is not understood; remove it, or apply it in the drawing program"
                )
        style = style_of(name, tag, element, self._document.rules, place.style)
        if style["display"] == "none":
            self._sheet.left_out.append(f"{name}: display: none")
            return None
        if is_none(style["opacity"]):
            self._sheet.left_out.append(f"{name}: opacity: 0")
            return None
        matrix = place.matrix @ matrix_of(name, element.get("transform"))
        for said in ("mask", "filter"):
            if style[said] != "none":
                raise DrawingRefused(f"{name}: {said} is not understood; remove it, or apply it in the drawing program")
        if style["clip"] not in ("auto", "none"):
            raise DrawingRefused(f"{name}: clip is not understood; remove it")
        inner = replace(place, matrix=matrix, style=style, depth=place.depth + 1)
        if style["clip-path"] != "none":
            clip = self._clip(style["clip-path"], name, inner)
            inner = replace(inner, clips=(*inner.clips, clip))
        return inner

    def _name(self, element: Element, tag: str) -> str:
        if tag in SHAPES:
            self._shapes += 1
        said = element.get("id")
        return f"{tag} {said!r}" if said else f"{tag} number {self._shapes}" if tag in SHAPES else tag

    def _length(self, element: Element, name: str, key: str, place: _Place, axis: str, default: float) -> float:
        return user_units(name, key, element.get(key), default, place.viewport, axis)

    def _shape(self, element: Element, tag: str, name: str, place: _Place) -> None:
        why = unpainted(place.style, area=tag != "line")
        if why is not None:
            self._sheet.left_out.append(f"{name}: {why}")
            return
        if markers(place.style):
            self._sheet.left_out.append(f"{name}: its markers")
        for points in self.curves_of(element, tag, name, place):
            if self._kept(name, points, place):
                self._sheet.draw(name, points * [1e-3, -1e-3])

    def curves_of(self, element: Element, tag: str, name: str, place: _Place) -> list[Array]:
        """The points (n, 2) of a shape's curves, mm on the page."""
        scale = float(np.linalg.norm(place.matrix[:2, :2], 2))
        data = self._data(element, tag, name, place)
        try:
            found = subpaths(data, FINE_M * 1e3 / scale)
        except DrawingRefused as error:
            raise DrawingRefused(f"{name}: {error}") from None
        return [points @ place.matrix[:2, :2].T + place.matrix[:2, 2] for points in found]

    def _data(self, element: Element, tag: str, name: str, place: _Place) -> str:
        """The shape as path data, user units."""

        def length(key: str, axis: str, default: float = 0.0) -> float:
            return self._length(element, name, key, place, axis, default)

        if tag == "path":
            return "" if (element.get("d") or "").strip() == "none" else element.get("d") or ""
        if tag == "line":
            return f"M{length('x1', 'x')!r} {length('y1', 'y')!r}L{length('x2', 'x')!r} {length('y2', 'y')!r}"
        if tag in ("polyline", "polygon"):
            values = numbers(element.get("points") or "")
            if values is None or len(values) % 2:
                raise DrawingRefused(f"{name}: points are not pairs of numbers; mend them")
            return f"M{element.get('points')}" + ("Z" if tag == "polygon" else "") if values else ""
        if tag == "rect":
            return _rectangle(element, length)
        cx, cy = length("cx", "x"), length("cy", "y")
        r = length("r", "r") if tag == "circle" else 0.0
        rx, ry = (r, r) if tag == "circle" else (length("rx", "x"), length("ry", "y"))
        if rx <= 0.0 or ry <= 0.0:
            return ""
        half = f"A{rx!r} {ry!r} 0 0 1 "
        return f"M{cx + rx!r} {cy!r}{half}{cx - rx!r} {cy!r}{half}{cx + rx!r} {cy!r}Z"

    def _kept(self, name: str, points: Array, place: _Place) -> bool:
        """Whether nothing of the curve is cut off, or all of it (then it is left out)."""
        if len(points) < 2:
            return True
        line = LineString(points)
        for clip, region in place.clips:
            if region.buffer(_CLIP_SLACK_MM).covers(line):
                continue
            closed = Polygon(points) if len(points) > 3 else line
            if not region.intersects(closed if closed.is_valid else line):
                self._sheet.left_out.append(f"{name}: outside of {clip}")
                return False
            raise DrawingRefused(
                f"{name}: {clip} cuts part of it off; cut the shape itself, or remove the {clip.split()[0]}"
            )
        return True

    def _clip(self, said: str, name: str, place: _Place) -> tuple[str, Geometry]:
        found = re.fullmatch(r"url\(\s*['\"]?#([^'\")]+)['\"]?\s*\)", said)
        element = None if found is None else self._document.by_id.get(found[1])
        if found is None or element is None or local_name(element) != "clipPath":
            raise DrawingRefused(f"{name}: clip-path {said[:40]} is not understood; remove it, or cut the shape itself")
        label = f"clip-path {found[1]!r}"
        if element.get("clipPathUnits", "userSpaceOnUse") != "userSpaceOnUse" or element.get("clip-path"):
            raise DrawingRefused(f"{name}: {label} is not understood; remove it, or cut the shape itself")
        inner = replace(place, matrix=place.matrix @ matrix_of(label, element.get("transform")))
        areas = []
        for child in element:
            tag = local_name(child)
            if tag is None or tag in ("title", "desc", "metadata"):
                continue
            style = style_of(label, tag, child, self._document.rules, {})
            if tag not in SHAPES or style["clip-path"] != "none":
                raise DrawingRefused(f"{name}: {label} holds {tag}, which is not understood; cut the shape itself")
            if style["display"] == "none" or style["visibility"] != "visible":
                continue
            own = replace(inner, matrix=inner.matrix @ matrix_of(label, child.get("transform")))
            rings = [points for points in self.curves_of(child, tag, label, own) if len(points) > 3]
            areas += [Polygon(points).buffer(0) for points in rings]
            if len(rings) > 1:
                raise DrawingRefused(
                    f"{name}: {label} is of several pieces, which is not understood; cut the shape itself"
                )
        return label, union_all(areas)

    def _use(self, element: Element, name: str, place: _Place) -> None:
        link = element.get("href") or element.get("{http://www.w3.org/1999/xlink}href") or ""
        target = self._document.by_id.get(link[1:]) if link.startswith("#") else None
        if target is None:
            raise DrawingRefused(f"{name} stands for {link or 'nothing'}, which is not in this file; draw it here")
        if link in place.used:
            raise DrawingRefused(f"{name} stands for {link}, which stands for itself; draw the outline itself")
        x, y = self._length(element, name, "x", place, "x", 0.0), self._length(element, name, "y", place, "y", 0.0)
        inner = replace(place, matrix=place.matrix @ shifted(x, y), inside=f" in {name}", used=(*place.used, link))
        tag = local_name(target)
        if tag == "symbol":
            label = f"symbol {link[1:]!r} in {name}"
            for key in ("x", "y", "refX", "refY"):
                if target.get(key) is not None:
                    raise DrawingRefused(f"{label}: {key} is not understood; remove it")
            entered = self.entered(target, "symbol", label, inner)
            if entered is None:
                return
            entered = self._viewport(target, element, label, entered)
            for child in target:
                self.element(child, entered)
            return
        if tag == "svg" and (element.get("width") or element.get("height")):
            raise DrawingRefused(f"{name}: width and height of a use of svg are not understood; use a symbol")
        self.element(target, inner)

    def _viewport(self, element: Element, sized: Element, name: str, place: _Place) -> _Place:
        """Into a viewport of an inner svg or a symbol; `sized` says how large it is."""
        full = Viewport(place.viewport.width, place.viewport.height)
        width, height = (
            user_units(name, key, sized.get(key) or element.get(key) or "100%", 0.0, full, axis)
            for key, axis in (("width", "x"), ("height", "y"))
        )
        if not width > 0.0 or not height > 0.0:
            raise DrawingRefused(f"{name}: its viewport has no size; mend width and height")
        said = sized.get("width") or element.get("width") or sized.get("height") or element.get("height")
        seen = view_box(name, element.get("viewBox"))
        matrix, clips = place.matrix, place.clips
        if place.style["overflow"] not in ("visible", "auto") and (said or seen):
            corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
            page = corners @ matrix[:2, :2].T + matrix[:2, 2]
            clips = (*clips, (f"viewport of {name}", Polygon(page)))
        if seen is None:
            return replace(place, clips=clips, viewport=Viewport(width, height))
        matrix = matrix @ fitted(name, seen, width, height, element.get("preserveAspectRatio"))
        return replace(place, matrix=matrix, clips=clips, viewport=Viewport(seen[2], seen[3]))


def _rectangle(element: Element, length: Callable[..., float]) -> str:
    x, y, w, h = length("x", "x"), length("y", "y"), length("width", "x"), length("height", "y")
    if w <= 0.0 or h <= 0.0:
        return ""
    rx, ry = length("rx", "x", -1.0), length("ry", "y", -1.0)
    rx, ry = (ry if rx < 0.0 else rx), (rx if ry < 0.0 else ry)
    rx, ry = min(max(rx, 0.0), w / 2.0), min(max(ry, 0.0), h / 2.0)
    if rx == 0.0 or ry == 0.0:
        return f"M{x!r} {y!r}h{w!r}v{h!r}h{-w!r}Z"
    arc = f"a{rx!r} {ry!r} 0 0 1 "
    return (
        f"M{x + rx!r} {y!r}h{w - 2.0 * rx!r}{arc}{rx!r} {ry!r}v{h - 2.0 * ry!r}{arc}{-rx!r} {ry!r}"
        f"h{2.0 * rx - w!r}{arc}{-rx!r} {-ry!r}v{2.0 * ry - h!r}{arc}{rx!r} {-ry!r}Z"
    )
