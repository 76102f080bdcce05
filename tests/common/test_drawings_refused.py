"""What of an SVG or DXF is moved, scaled, hidden or strange: read rightly, left out by name, or refused by name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ezdxf.document import Drawing

from crosspih_common.shapes.drawn import DrawingRefused
from crosspih_common.shapes.importing import DrawingRead, read_drawing
from tests.common.drawn_dxf import dxf

HEAD = '<svg xmlns="http://www.w3.org/2000/svg" width="60mm" height="60mm" viewBox="0 0 60 60">'
STEP = '<path d="M 10 12 H 50 V 44 H 24 V 36 H 10 Z"/>'
DOT = 'cx="30" cy="30" r="3"'


def svg(folder: Path, inside: str, head: str = HEAD) -> DrawingRead:
    path = folder / "drawn.svg"
    path.write_text(f"{head}{inside}</svg>", encoding="utf-8")
    return read_drawing(path)


def page(width: str, height: str, box: str = "0 0 60 60", more: str = "") -> str:
    return f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="{box}" {more}>'


@pytest.mark.parametrize(
    ("head", "area", "size"),
    [
        (page("60 mm", "60mm"), 1168.0, (40.0, 32.0)),
        (page("60MM", "6cm"), 1168.0, (40.0, 32.0)),
        (page("240q", "240Q"), 1168.0, (40.0, 32.0)),
        (page("2in", "144 pt", "0 0 60 60"), 1168.0 * (25.4 / 30.0) ** 2, (40 * 25.4 / 30, 32 * 25.4 / 30)),
        # twice as wide as high: the smaller scale counts, unless it is said otherwise
        (page("120mm", "60mm"), 1168.0, (40.0, 32.0)),
        (page("120mm", "60mm", more='preserveAspectRatio="none"'), 2336.0, (80.0, 32.0)),
        (page("120mm", "60mm", more='preserveAspectRatio="xMinYMax slice"'), 4672.0, (80.0, 64.0)),
    ],
)
def test_a_page_is_read_at_its_scale(tmp_path: Path, head: str, area: float, size: tuple[float, float]) -> None:
    contour = svg(tmp_path, STEP, head).contour
    assert contour.area_m2 * 1e6 == pytest.approx(area, rel=1e-6)
    assert (contour.width_m * 1e3, contour.height_m * 1e3) == pytest.approx(size, rel=1e-6)


@pytest.mark.parametrize(
    ("inside", "left_out"),
    [
        (f'<g style="display:none"><circle {DOT}/></g>', "g: display: none"),
        (f'<style>.a, circle.b {{ display : none !important }}</style><circle class="b" style="display:inline" {DOT}/>',
         "circle number 1: display: none"),
        (f'<g visibility="hidden"><circle {DOT}/></g>', "circle number 1: visibility: hidden"),
        (f'<circle visibility="collapse" {DOT}/>', "circle number 1: visibility: collapse"),
        (f'<g opacity="0.0"><circle {DOT}/></g>', "g: opacity: 0"),
        (f'<circle fill="none" {DOT}/>', "circle number 1: neither fill nor stroke"),
        (f'<g style="fill:transparent;stroke:black;stroke-width:0px"><circle id="dot" {DOT}/></g>',
         "circle 'dot': neither fill nor stroke"),
        (f'<circle fill-opacity="0%" {DOT}/>', "circle number 1: neither fill nor stroke"),
        (f'<circle fill="#ff000000" stroke="rgba(1, 2, 3, 0)" {DOT}/>', "circle number 1: neither fill nor stroke"),
        ('<line x1="1" y1="1" x2="9" y2="9"/>', "line number 1: neither fill nor stroke"),
        ('<text x="3" y="3">peg</text>', "text: a text"),
        (f'<clipPath id="c"><rect width="5" height="5"/></clipPath><circle clip-path="url(#c)" {DOT}/>',
         "circle number 1: outside of clip-path 'c'"),
        (f'<svg width="5" height="5"><circle {DOT}/></svg>', "circle number 1: outside of viewport of svg"),
    ],
)  # fmt: skip
def test_what_is_not_seen_is_left_out_by_name(tmp_path: Path, inside: str, left_out: str) -> None:
    read = svg(tmp_path, inside + STEP)
    assert read.contour.area_m2 * 1e6 == pytest.approx(1168.0)
    assert list(read.left_out) == [left_out]


@pytest.mark.parametrize(
    "inside",
    [
        f'<g visibility="hidden"><g visibility="visible">{STEP}</g></g>',
        f'<defs><circle {DOT}/></defs>{STEP}',
        f'<symbol id="s"><circle {DOT}/></symbol><marker><circle {DOT}/></marker>{STEP}',
        f'<clipPath id="c"><rect width="60" height="60"/></clipPath><g clip-path="url(#c)">{STEP}</g>',
        '<defs><path id="p" d="M0 0h20v16h-13v-4h-7z"/></defs><use x="5" y="6" href="#p" transform="scale(2)"/>',
        '<symbol id="s" viewBox="0 0 30 30"><path d="M 5 6 H 25 V 22 H 12 V 18 H 5 Z"/></symbol>'
        '<use href="#s" width="60" height="60"/>',
        '<symbol id="s" viewBox="0 0 30 30"><path d="M 5 6 H 25 V 22 H 12 V 18 H 5 Z"/></symbol>'
        '<g transform="translate(10 0)"><use href="#s" width="120" height="60" x="-40"/></g>',
        '<svg x="3" width="100%" height="60%" viewBox="0 0 240 120"><g transform="scale(8) translate(-5 -6)">'
        '<path d="M 5 6 H 25 V 22 H 12 V 18 H 5 Z"/></g></svg>',
        '<g transform="matrix(0 1 -1 0 60 0)"><g transform="skewX(20) skewX(-20)"><path d="m 10,12 h 40 v 32 h-26 '
        'v-8h-14z" transform="rotate(-90, 30 30),rotate(90 30 30)"/></g></g>',
    ],
)  # fmt: skip
def test_what_stands_for_others_or_moves_them_is_followed(tmp_path: Path, inside: str) -> None:
    contour = svg(tmp_path, inside).contour
    assert contour.area_m2 * 1e6 == pytest.approx(1168.0, rel=1e-6)
    assert sorted((contour.width_m * 1e3, contour.height_m * 1e3)) == pytest.approx([32.0, 40.0])
    assert contour.corners == 6


@pytest.mark.parametrize(
    ("inside", "words"),
    [
        ('<path d="M10 10 L 40 x"/>', r"path number 1: path data L 40 x is not understood"),
        ('<path d="L10 10"/>', "begins with L; it wants M first"),
        ('<path d="M10 10 A 5 5 0 2 0 9 9"/>', "wants 7 numbers"),
        ('<path d="M0 0 H 1e400 V 3 Z"/>', "a number beyond all measure"),
        (f'<g transform="rotate(30deg)">{STEP}</g>', r"g: transform 'rotate\(30deg\)' is not understood"),
        (f'<g transform="scale(0)">{STEP}</g>', "leaves nothing of it"),
        (f'<g style="transform: scale(2)">{STEP}</g>', r"g: the style says transform: scale\(2\)"),
        (f"<style>path {{ transform: scale(2) }}</style>{STEP}", r"style: the style says transform"),
        (f"<style>g > path {{ display: none }}</style>{STEP}", "selector 'g > path' is not understood and says"),
        (f"<style>@media print {{ path {{ display: none }} }}</style>{STEP}", "'@media print' is not understood"),
        (f"<style>@import 'a.css';</style>{STEP}", "@import 'a.css'"),
        (f'<mask id="m"><rect width="20" height="60" fill="white"/></mask><g mask="url(#m)">{STEP}</g>', "g: mask is"),
        (f'<clipPath id="c"><rect width="20" height="60"/></clipPath><g clip-path="url(#c)">{STEP}</g>',
         "path number 1: clip-path 'c' cuts part of it off"),
        (f'<g clip-path="circle(10px)">{STEP}</g>', r"clip-path circle\(10px\) is not understood"),
        (f'<g filter="url(#f)">{STEP}</g>', "g: filter is not understood"),
        (f'<image href="a.png" width="9" height="9"/>{STEP}', "image is not understood as part of an outline"),
        (f"<switch>{STEP}</switch>", "switch is not understood"),
        (f"<animate/>{STEP}", "animate is not understood"),
        (f"<foreignObject/>{STEP}", "foreignObject is not understood"),
        ('<use href="other.svg#p"/>', r"use stands for other.svg#p, which is not in this file"),
        ('<g id="a"><use href="#a"/></g>', "which stands for itself"),
        ('<circle cx="3em" cy="3" r="2"/>', r"circle number 1: cx is '3em'; write a number"),
        ('<circle cx="30" cy="30" r="20"/><circle cx="30" cy="30" r="10"/>', "holds 2 outlines .circle number 1,"),
        ('<path d="M0 0H30V30"/><path d="M30 30.02H0V0"/>',
         r"gap of 0\.020 mm, at \(30\.000, 30\.000\) and \(30\.000, 30\.020\) mm; close it|"
         r"ends are 0\.020 mm apart, at \(30\.000, 30\.0[02]0\) and \(30\.000, 30\.0[02]0\) mm; close it"),
        ('<path d="M0 0H30V30L0 0"/><path d="M0 0V30"/>', r"open: its ends are 30\.000 mm apart|three ends meet"),
        ('<path d="M0 0H30V30"/><path d="M0 0L30 30"/><path d="M30 30L0 0"/>', "is drawn twice, path number 3 lies"),
        ('<polygon points="0,0 30,30 30,0 0,30"/>', "may not cross or touch itself"),
        ('<polygon points="0,0 30,30 0,0"/>', "no area|may not cross"),
        ('<a id="x"/><b xmlns="" id="x"/>' + STEP, "two elements have the id 'x'|b is not understood"),
    ],
)  # fmt: skip
def test_what_is_not_understood_is_refused_by_name(tmp_path: Path, inside: str, words: str) -> None:
    with pytest.raises(DrawingRefused, match=words):
        svg(tmp_path, inside)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('<!DOCTYPE svg [<!ENTITY a "xxxxxxxxxx"><!ENTITY b "&a;&a;&a;&a;">]>' + HEAD + "&b;</svg>", "the entity 'b'"),
        ('<!DOCTYPE svg [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + HEAD + "&a;</svg>", "the entity 'a'"),
        ('<?xml-stylesheet href="a.css"?>' + HEAD + STEP + "</svg>", "takes its style from another file"),
        (HEAD + "<g>" * 5000 + STEP + "</g>" * 5000 + "</svg>", "more than 200 deep"),
        (HEAD + STEP, "is no SVG: no element found"),
        ("hello", "is no SVG"),
        ("<html/>", "its root is 'html'"),
        (page("60px", "60mm") + STEP + "</svg>", "width has no unit of length .got '60px'"),
        (page("60mm", "100%") + STEP + "</svg>", "height has no unit of length .got '100%'"),
        (page("60mm", "60mm", "0 0 0 60") + STEP + "</svg>", "viewBox is '0 0 0 60'"),
        (page("60mm", "60mm", more='preserveAspectRatio="middle"') + STEP + "</svg>", "preserveAspectRatio 'middle'"),
    ],
)
def test_files_that_are_no_drawing_or_grow_are_refused(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "drawn.svg"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(DrawingRefused, match=words):
        read_drawing(path)


def test_namespaces_by_entities_are_read(tmp_path: Path) -> None:
    path = tmp_path / "drawn.svg"
    head = HEAD.replace("http://www.w3.org/2000/svg", "&s;")
    path.write_text(f'<!DOCTYPE svg [<!ENTITY s "http://www.w3.org/2000/svg">]>{head}{STEP}</svg>', encoding="utf-8")
    assert read_drawing(path).contour.area_m2 * 1e6 == pytest.approx(1168.0)


def test_what_stands_for_ever_more_is_refused_soon(tmp_path: Path) -> None:
    levels = "".join(f'<g id="l{n + 1}">' + f'<use href="#l{n}"/>' * 10 + "</g>" for n in range(9))
    with pytest.raises(DrawingRefused, match="more than 20000 parts are drawn"):
        svg(tmp_path, f'<defs><path id="l0" d="M0 0h1v1z"/>{levels}</defs><use href="#l9"/>')

    def bomb(document: Drawing) -> None:
        document.blocks.new("b0").add_line((0, 0), (1, 0))
        for n in range(9):
            block = document.blocks.new(f"b{n + 1}")
            for _ in range(10):
                block.add_blockref(f"b{n}", (0, 0))
        document.modelspace().add_blockref("b9", (0, 0))

    with pytest.raises(DrawingRefused, match="more than 20000 parts are drawn"):
        dxf(tmp_path, bomb)


def test_two_hundred_thousand_points_are_read_or_refused(tmp_path: Path) -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 200_000, endpoint=False)
    points = " ".join(f"{30 + 20 * np.cos(a):.9f},{30 + 20 * np.sin(a):.9f}" for a in angles)
    read = svg(tmp_path, f'<polygon points="{points}"/>')
    assert read.contour.symmetry == 0 and len(read.outline().corners_m) == 64
    rough = " ".join(f"{30 + (20 + n % 2) * np.cos(a):.9f},{30 + (20 + n % 2) * np.sin(a):.9f}"
                     for n, a in enumerate(angles[::100]))  # fmt: skip
    with pytest.raises(DrawingRefused, match="corners once its curves are chords, more than 64; simplify it"):
        svg(tmp_path, f'<polygon points="{rough}"/>').outline()


CORNERS = [(10, 12), (50, 12), (50, 44), (24, 44), (24, 36), (10, 36)]


def outline(document: Drawing, **attributes: Any) -> None:
    document.modelspace().add_lwpolyline(CORNERS, close=True, dxfattribs=attributes)


def _hidden(document: Drawing, case: str) -> None:
    space = document.modelspace()
    outline(document)
    layer = document.layers.add("HELP")
    if case == "off":
        layer.off()
    elif case == "frozen":
        layer.freeze()
    elif case == "plotted":
        layer.dxf.plot = 0
    if case in ("off", "frozen", "plotted"):
        space.add_circle((30, 30), 3, dxfattribs={"layer": "HELP"})
    elif case == "block":
        layer.freeze()
        document.blocks.new("b").add_circle((30, 30), 3)
        space.add_blockref("b", (0, 0), dxfattribs={"layer": "HELP"})
    elif case == "block 0":
        layer.off()
        document.blocks.new("b").add_circle((30, 30), 3)  # on layer 0: that of the INSERT
        space.add_blockref("b", (0, 0), dxfattribs={"layer": "HELP"})
    elif case == "invisible":
        space.add_circle((30, 30), 3, dxfattribs={"invisible": 1})
    elif case == "Defpoints":
        space.add_line((0, 0), (9, 0), dxfattribs={"layer": "Defpoints"})
    elif case == "text":
        space.add_mtext("40 wide")
    elif case == "dimension":
        space.add_linear_dim((10, 5), (10, 12), (50, 12)).render()
    elif case == "hatch":
        space.add_hatch().paths.add_polyline_path(CORNERS, is_closed=True)
    elif case == "layout":
        document.layout("Layout1").add_circle((30, 30), 3)


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("off", "CIRCLE .* on layer HELP: its layer is off"),
        ("frozen", "CIRCLE .* on layer HELP: its layer is frozen"),
        ("plotted", "its layer is not plotted"),
        ("block", "INSERT .*: its layer is frozen"),
        ("block 0", "CIRCLE .* on layer HELP in the block 'b': its layer is off"),
        ("invisible", "CIRCLE .*: invisible"),
        ("Defpoints", "LINE .* on layer Defpoints: its layer is not plotted"),
        ("text", "MTEXT .*: a text"),
        ("dimension", "DIMENSION .*: a dimension"),
        ("hatch", "HATCH .*: fills an outline that is drawn"),
        ("layout", "layout 'Layout1': 1 entities"),
    ],
)
def test_what_a_dxf_does_not_show_is_left_out_by_name(tmp_path: Path, case: str, words: str) -> None:
    read = dxf(tmp_path, lambda document: _hidden(document, case))
    assert read.contour.area_m2 * 1e6 == pytest.approx(1168.0)
    assert len(read.left_out) == 1 and re.search(words, read.left_out[0])


def _inserted(document: Drawing, case: str) -> None:
    space, block = document.modelspace(), document.blocks.new("b", base_point=(10, 12))
    scaled = [(x / 2, y / 2) for x, y in CORNERS] if case in ("scaled", "mirrored") else CORNERS
    block.add_lwpolyline(scaled, close=True)
    hows: dict[str, dict[str, Any]] = {
        "plain": {}, "turned": {"rotation": 30}, "scaled": {"xscale": 2, "yscale": 2},
        "mirrored": {"xscale": -2, "yscale": 2}, "array": {"column_count": 1, "row_count": 1},
        "extruded": {"extrusion": (0, 0, -1)},
    }  # fmt: skip
    space.add_blockref("b", (3, 4), dxfattribs=hows[case])


@pytest.mark.parametrize("case", ["plain", "turned", "scaled", "mirrored", "array", "extruded"])
def test_blocks_are_followed(tmp_path: Path, case: str) -> None:
    contour = dxf(tmp_path, lambda document: _inserted(document, case)).contour
    assert contour.area_m2 * 1e6 == pytest.approx(1168.0, rel=1e-6)
    assert contour.corners == 6


def _strange(document: Drawing, case: str) -> None:
    space = document.modelspace()
    if case == "xline":
        outline(document)
        space.add_xline((0, 0), (1, 0))
    elif case == "solid":
        outline(document)
        space.add_3dface([(0, 0), (1, 0), (1, 1), (0, 1)])
    elif case == "array":
        document.blocks.new("b").add_circle((0, 0), 10)
        space.add_blockref("b", (0, 0), dxfattribs={"column_count": 2, "row_count": 1, "column_spacing": 30})
    elif case == "missing":
        space.add_blockref("nowhere", (0, 0))
    elif case == "itself":
        document.blocks.new("b").add_blockref("b", (0, 0))
        space.add_blockref("b", (0, 0))
    elif case == "tilted":
        space.add_circle((0, 0), 20, dxfattribs={"extrusion": (0, 1, 1)})
    elif case == "gap":
        for start, end in (((0, 0), (40, 0)), ((40, 0.02), (40, 32)), ((40, 32), (0, 32)), ((0, 32), (0, 0))):
            space.add_line(start, end)
    elif case == "twice":
        space.add_line((0, 0), (40, 0))
        space.add_line((40, 0), (0, 0))
        space.add_line((40, 0), (20, 30))
        space.add_line((20, 30), (0, 0))
    elif case == "far":
        space.add_circle((0, 0), 1e9)
    elif case == "fitted":
        space.add_polyline2d([(0, 0), (40, 0), (40, 30)], close=True, dxfattribs={"flags": 5})


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("xline", "XLINE .* is not understood as part of an outline"),
        ("solid", "3DFACE .* is not understood"),
        ("array", "holds 2 outlines"),
        ("missing", "there is no block 'nowhere' in this file"),
        ("itself", "the block 'b' holds itself"),
        ("tilted", "CIRCLE .* leaves the plane of the drawing"),
        ("gap", r"its ends are 0\.020 mm apart, at \(40\.000, 0\.0[02]0\) and \(40\.000, 0\.0[02]0\) mm; close it"),
        ("twice", r"LINE .* is drawn twice, LINE .* lies on it; delete one"),
        ("far", "farther than a kilometre off"),
        ("fitted", "a spline fitted to a polyline"),
    ],
)
def test_what_of_a_dxf_is_not_understood_is_refused_by_name(tmp_path: Path, case: str, words: str) -> None:
    with pytest.raises(DrawingRefused, match=words):
        dxf(tmp_path, lambda document: _strange(document, case))


def test_a_dxf_of_too_many_entities_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "drawn.dxf"
    path.write_text("  0\nSECTION\n" + "  0\nVERTEX\n 10\n1.0\n" * 200_000, encoding="ascii")
    with pytest.raises(DrawingRefused, match="holds 200000 entities and vertices, more than 10000"):
        read_drawing(path)


def test_a_block_scaled_unevenly_makes_ellipses_of_its_circles(tmp_path: Path) -> None:
    def draw(document: Drawing) -> None:
        document.blocks.new("b").add_circle((1, 1), 10)
        document.modelspace().add_blockref("b", (0, 0), dxfattribs={"xscale": 2, "yscale": 1, "rotation": 90})

    contour = dxf(tmp_path, draw).contour
    assert (contour.width_m, contour.height_m) == pytest.approx((0.02, 0.04), abs=2e-6)
    assert contour.area_m2 == pytest.approx(np.pi * 2e-4, rel=1e-3)
    assert (contour.corners, contour.symmetry) == (0, 2)


@pytest.mark.parametrize(("unit", "metres"), [(1, 0.0254), (2, 0.3048), (4, 1e-3), (5, 1e-2), (6, 1.0), (13, 1e-6)])
def test_units_of_a_dxf(tmp_path: Path, unit: int, metres: float) -> None:
    side = 0.03 / metres
    read = dxf(tmp_path, lambda document: document.modelspace().add_lwpolyline(
        [(0, 0), (side, 0), (side, side), (0, side)], close=True), unit)  # fmt: skip
    assert read.contour.area_m2 == pytest.approx(9e-4)
    assert read.contour.symmetry == 4
