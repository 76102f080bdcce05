"""The same contour gives the same peg however it is drawn, and what is round, cornered or symmetric is seen on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ezdxf.document import Drawing
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Outline, Peg
from crosspih_common.shapes.importing import DrawingRead, read_drawing
from crosspih_common.shapes.named import NAMED, Sizes, tapered
from crosspih_common.shapes.outline import symmetry_of
from services.inference.estimator.bore import BoreWalls
from tests.common.drawn_dxf import dxf

HEAD = '<svg xmlns="http://www.w3.org/2000/svg" width="{w}" height="{h}" viewBox="{box}">{inside}</svg>'
K = 0.5522847498307936  # of a circle's quarter by a Bezier


def svg(folder: Path, inside: str, w: str = "60mm", h: str = "60mm", box: str = "0 0 60 60") -> DrawingRead:
    path = folder / "drawn.svg"
    path.write_text(HEAD.format(w=w, h=h, box=box, inside=inside), encoding="utf-8")
    return read_drawing(path)


def chords(count: int, radius: float, start: float = 0.1) -> str:
    angles = start + np.arange(count) * (2.0 * np.pi / count)
    return " ".join(f"{30 + radius * np.cos(a):.6f},{30 + radius * np.sin(a):.6f}" for a in angles)


def circles(r: float) -> dict[str, str]:
    """Of radius r about (30, 30), each drawn otherwise."""
    k, left, right, top, low = K * r, 30 - r, 30 + r, 30 - r, 30 + r
    uneven = np.sort(np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, 400))
    points = " ".join(f"{30 + r * np.cos(a):.6f},{30 + r * np.sin(a):.6f}" for a in uneven)
    return {
        "circle": f'<circle cx="30" cy="30" r="{r}"/>',
        "ellipse": f'<ellipse cx="30" cy="30" rx="{r}" ry="{r}"/>',
        "two arcs": f'<path d="M{right} 30A{r} {r} 0 0 1 {left} 30A{r} {r} 0 0 1 {right} 30Z"/>',
        "two paths": f'<path d="M{right} 30A{r} {r} 0 0 1 {left} 30"/><path d="M{right} 30a{r},{r} 0 00{-2 * r},0"/>',
        "Beziers": f'<path d="M{right} 30C{right} {30 + k} {30 + k} {low} 30 {low}S{left} {30 + k} {left} 30'
        f'S{30 - k} {top} 30 {top}S{right} {30 - k} {right} 30z"/>',
        "round corners": f'<rect x="{left}" y="{top}" width="{2 * r}" height="{2 * r}" rx="{r}"/>',
        "100 chords": f'<polygon points="{chords(100, r)}"/>',
        "uneven chords": f'<polygon points="{points}"/>',
    }


@pytest.mark.parametrize("how", list(circles(20.0)))
def test_a_circle_is_round_however_it_is_drawn(tmp_path: Path, how: str) -> None:
    read = svg(tmp_path, circles(20.0)[how])
    contour, outline = read.contour, read.outline()
    assert (contour.symmetry, contour.corners, outline.symmetry_order) == (0, 0, 0)
    assert contour.area_m2 == pytest.approx(np.pi * 4e-4, rel=2e-3)
    assert (contour.width_m, contour.height_m) == pytest.approx((0.04, 0.04), abs=3e-5)
    np.testing.assert_allclose(outline.corners_m, NAMED_ROUND.corners_m, atol=1e-5)


ANGLES = np.arange(64) * (2.0 * np.pi / 64)
NAMED_ROUND = Outline.of("round", 0.02 * np.column_stack([np.cos(ANGLES), np.sin(ANGLES)]))


def test_a_circle_of_two_arcs_in_a_dxf_is_the_same_round(tmp_path: Path) -> None:
    def arcs(document: Drawing) -> None:
        document.modelspace().add_arc((5, 5), 20, 0, 180)
        document.modelspace().add_arc((5, 5), 20, 180, 360)

    def bulges(document: Drawing) -> None:
        document.modelspace().add_lwpolyline([(0, 0, 1.0), (40, 0, 1.0)], format="xyb", close=True)

    for draw in (arcs, bulges):
        read = dxf(tmp_path, draw)
        assert read.contour.symmetry == 0
        np.testing.assert_allclose(read.outline().corners_m, NAMED_ROUND.corners_m, atol=1e-5)


def test_nothing_tells_how_a_peg_is_turned_that_turns_freely_in_its_hole(tmp_path: Path) -> None:
    def walls(read: DrawingRead) -> BoreWalls:
        outline = read.outline()
        peg: Peg = tapered(outline, 0.012, 0.0537, 0.0797, 0.5)
        return BoreWalls.of(peg, peg.hole(1e-4, 1e-3))

    assert not walls(svg(tmp_path, circles(20.0)["two arcs"])).turn_fixed
    # an ellipse that is longer than it is wide by half the clearance
    assert not walls(svg(tmp_path, '<ellipse cx="30" cy="30" rx="20.06" ry="20"/>')).turn_fixed
    assert walls(svg(tmp_path, '<ellipse cx="30" cy="30" rx="22" ry="20"/>')).turn_fixed


SHAPES: dict[str, tuple[int, int, float, float, float]] = {
    # corners, symmetry, area, width, height; mm
    "d": (2, 1, 10.0**2 * np.pi / 2.0 + 0.0, 20.0, 10.0),
    "slot": (0, 2, 20.0 * 16.0 + np.pi * 64.0, 36.0, 16.0),
    "square": (4, 4, 900.0, 30.0, 30.0),
    "step": (6, 1, 1168.0, 40.0, 32.0),
}


def points_of(shape: str, chord_mm: float) -> Array:
    """(n, 2), mm, the arcs in chords of about that length."""
    if shape == "square":
        return np.array([[0, 0], [30, 0], [30, 30], [0, 30]], dtype=float)
    if shape == "step":
        return np.array([[10, 12], [50, 12], [50, 44], [24, 44], [24, 36], [10, 36]], dtype=float)

    def arc(x: float, r: float, first: float, last: float) -> Array:
        steps = max(8, round(abs(last - first) * r / chord_mm))
        angles = np.linspace(first, last, steps + 1)
        return np.column_stack([x + r * np.cos(angles), r * np.sin(angles)])

    if shape == "d":
        return arc(0.0, 10.0, 0.0, np.pi)
    half = np.pi / 2.0
    return np.vstack([arc(10.0, 8.0, -half, half), arc(-10.0, 8.0, half, 3.0 * half)])


def curved(shape: str) -> str:
    if shape == "d":
        return "M10 0A10 10 0 0 1 -10 0Z"
    if shape == "slot":
        return "M10 -8A8 8 0 0 1 10 8H-10A8 8 0 0 1 -10 -8z"
    return "M" + " ".join(f"{x},{y}" for x, y in points_of(shape, 1.0)) + "z"


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    st.sampled_from(list(SHAPES)), st.floats(-180.0, 180.0), st.booleans(), st.floats(0.7, 1.6), st.floats(-5.0, 5.0)
)
def test_a_contour_drawn_six_ways_is_one(
    tmp_path_factory: pytest.TempPathFactory, shape: str, turn: float, mirrored: bool, scale: float, shift: float
) -> None:
    folder = tmp_path_factory.mktemp("drawn")
    corners, symmetry, area, _, _ = SHAPES[shape]
    flip = -1.0 if mirrored else 1.0
    cos, sin = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
    # in a drawing with y up
    matrix = scale * np.array([[cos, -sin], [sin, cos]]) @ np.diag([flip, 1.0])
    moved = f"translate({30 + shift} {30 - shift}) rotate({turn}) scale({scale * flip} {scale})"
    text = " ".join(f"{x},{y}" for x, y in points_of(shape, 0.3))
    transformed = points_of(shape, 0.3) @ matrix.T + [30 + shift, 30 - shift]
    baked = " ".join(f"{x:.7f},{y:.7f}" for x, y in transformed)
    d = curved(shape)
    inches = "".join(f'<line x1="{a[0]}" y1="{a[1]}" x2="{b[0]}" y2="{b[1]}" stroke="red"/>' for a, b in zip(
        transformed[::-1] / 25.4, np.roll(transformed[::-1], -1, axis=0) / 25.4, strict=True))  # fmt: skip

    def block(document: Drawing) -> None:
        inner = document.blocks.new("peg", base_point=(1.0, 2.0))
        inner.add_lwpolyline(points_of(shape, 0.3) + np.array([1.0, 2.0]), close=True)
        document.blocks.new("outer").add_blockref("peg", (0, 0), dxfattribs={"xscale": flip})
        document.modelspace().add_blockref(
            "outer", (shift, 3.0), dxfattribs={"rotation": turn, "xscale": scale / 10, "yscale": scale / 10}
        )

    drawn = [
        svg(folder, f'<g transform="{moved}"><path d="{d}"/></g>'),
        svg(folder, f'<polygon points="{baked}"/>'),
        svg(folder, f'<symbol id="s" overflow="visible"><polygon points="{text}"/></symbol>'
                    f'<g transform="translate({30 + shift},{30 - shift})"><use href="#s" transform="rotate({turn}) '
                    f'scale({scale * flip},{scale})"/></g>'),
        svg(folder, inches, w="4in", h="4 in", box="0 0 4 4"),
        svg(folder, f'<path transform="matrix({matrix[0, 0]} {matrix[1, 0]} {matrix[0, 1]} {matrix[1, 1]} 30 30)" '
                    f'd="{d}"/>', w="120mm", h="60mm", box="0 0 60 60"),
    ]  # fmt: skip
    mirrored_y = dxf(folder, block, unit=5)
    sizes = []
    for read in (*drawn, mirrored_y):
        contour = read.contour
        assert (contour.corners, contour.symmetry) == (corners, symmetry)
        assert read.outline().symmetry_order == symmetry
        assert contour.area_m2 * 1e6 == pytest.approx(area * scale**2, rel=1.5e-3)
        sizes.append((contour.width_m, contour.height_m))
    for size in sizes[1:-1]:
        assert size == pytest.approx(sizes[0], abs=3e-5)


def test_a_polygons_symmetry_is_that_of_its_line_and_not_of_its_corners() -> None:
    square = np.array([[-1, -1], [0.3, -1], [1, -1], [1, 1], [-1, 1]]) * 0.02
    assert symmetry_of(square) == 4
    uneven = np.sort(np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, 300))
    assert symmetry_of(0.02 * np.column_stack([np.cos(uneven), np.sin(uneven)])) == 0
    assert symmetry_of(square * [1.0, 1.01]) == 2
    for name, make in NAMED.items():
        outline = make(Sizes())
        assert symmetry_of(outline.corners_m) == outline.symmetry_order, name
