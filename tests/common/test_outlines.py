"""Pegs and holes of any section: the convex pieces are exactly the shape, whatever its outline."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from crosspih_common.config import HoleDrawing, PegDrawing
from crosspih_common.config.drawing import OUTLINES
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import ConvexPiece, CrossPeg, Hole, Outline, Peg, cross_outline
from crosspih_common.shapes.named import star, tapered

# sections that have no name, mm: an L about the place that sees all of it, and two with walls that no place sees
ELL = [(-24, -6), (4, -6), (4, 22), (-4, 22), (-4, 6), (-24, 6)]
UNSEEN = {
    "slotted": [(-20, -20), (20, -20), (20, 20), (4, 20), (4, 8), (-4, 8), (-4, 20), (-20, 20)],
    "tee": [(-5, -20), (5, -20), (5, 10), (20, 10), (20, 20), (-20, 20), (-20, 10), (-5, 10)],
}
ORDERS = {
    "cross": 4, "square": 4, "triangle": 3, "hexagon": 6, "star": 5, "spline": 6, "keyway": 1, "round": 0,
}  # fmt: skip


def _peg(name: str) -> Peg:
    if name == "ell":
        return tapered(Outline.of(name, np.array(ELL) * 1e-3), 0.012, 0.0537, 0.0797, 0.4)
    return PegDrawing(outline=name).shape()


def _inside(pieces: list[ConvexPiece], points: Array) -> Array:
    return np.asarray(np.any([piece.contains(points) for piece in pieces], axis=0))


def _assert_peg_is_exact(peg: Peg, points_each: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    wide = peg.outline.radius_m * 1.1
    section = Polygon(peg.outline.corners_m)
    for z in rng.uniform(peg.body_start_m - 0.002, peg.tip_m + 0.002, 8):
        points = np.column_stack([rng.uniform(-wide, wide, (points_each, 2)), np.full(points_each, z)])
        x, y, _ = points.T / peg.scale_at(z)
        truly = shapely.contains_xy(section, x, y) & (peg.body_start_m < z < peg.tip_m)
        assert np.array_equal(_inside(peg.pieces(), points), truly)


def _assert_hole_is_exact(hole: Hole, points_each: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = hole.plate_half_size_m
    blocks = hole.pieces()
    for z in (*rng.uniform(0.0, hole.chamfer_m, 5), *rng.uniform(hole.chamfer_m, hole.depth_m, 3)):
        near = rng.uniform(-0.035, 0.035, (points_each, 2))
        points = np.vstack([near, rng.uniform(-size, size, (points_each // 4, 2))])
        open_at = Polygon(hole.outline.grown(max(0.0, hole.chamfer_m - z)).corners_m)
        solid = ~shapely.contains_xy(open_at, *points.T)
        assert np.array_equal(_inside(blocks, np.column_stack([points, np.full(len(points), z)])), solid)


@pytest.mark.parametrize("name", [*OUTLINES, "ell"])
def test_pieces_and_blocks_are_exactly_the_shape(name: str) -> None:
    peg = _peg(name)
    _assert_peg_is_exact(peg, 1500, 1)
    _assert_hole_is_exact(HoleDrawing().shape(peg), 1500, 2)


@settings(max_examples=12, deadline=None)
@given(
    st.integers(3, 9).flatmap(lambda count: st.lists(st.floats(0.012, 0.027), min_size=count, max_size=count)),
    st.floats(0.0, 6.28),
)
def test_any_outline_round_its_axis_is_cut_exactly(radii: list[float], turn_rad: float) -> None:
    angles = turn_rad + np.arange(len(radii)) * (2.0 * np.pi / len(radii))
    corners = np.array(radii)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    peg = tapered(Outline.of("any", corners), 0.012, 0.0537, 0.0797, 0.5)
    _assert_peg_is_exact(peg, 300, 3)
    _assert_hole_is_exact(peg.hole(1e-4), 300, 4)


@pytest.mark.parametrize("name", UNSEEN)
def test_a_hole_may_have_slots_but_no_tapered_peg_has(name: str) -> None:
    outline = Outline.of(name, np.array(UNSEEN[name]) * 1e-3)
    _assert_hole_is_exact(Hole(outline.grown(1e-4)), 800, 5)
    with pytest.raises(ValueError, match="axis does not see the wall that begins at"):
        tapered(outline, 0.012, 0.0537, 0.0797, 0.4)


def test_the_cross_comes_out_as_its_two_bars_and_eight_blocks() -> None:
    outline = Outline.of("cross", cross_outline(0.009, 0.027))
    peg = tapered(outline, 0.012, 0.0537, 0.0797, 0.0025 / 0.009)
    cross = CrossPeg()
    assert len(peg.pieces()) == 2
    assert len(peg.hole(1e-4).pieces()) == 8
    assert peg.apex_m == pytest.approx(cross.apex_m)
    for ours, own in zip(peg.taper_edges_m(), cross.taper_edges_m(), strict=True):
        np.testing.assert_allclose(ours, own, atol=1e-12)


@pytest.mark.parametrize("name", OUTLINES)
def test_symmetry_is_named_and_found(name: str) -> None:
    outline = _peg(name).outline
    assert outline.symmetry_order == ORDERS[name]
    assert Outline.of(name, outline.corners_m).symmetry_order == ORDERS[name]


def test_a_rim_lies_on_its_hole_corner_by_corner() -> None:
    for name in OUTLINES:
        hole = HoleDrawing().shape(_peg(name))
        inner, outer = hole.inner_rim_m(), hole.outer_rim_m()
        assert np.all(inner[:, 2] == hole.chamfer_m)
        assert np.all(outer[:, 2] == 0.0)
        # each edge of the face is the bore's, moved out by the chamfer
        moved = np.sum(hole.outline.normals * (outer - inner)[:, :2], axis=1)
        np.testing.assert_allclose(moved, hole.chamfer_m, atol=1e-12)


def test_a_round_keeps_its_stated_clearance_at_any_turn() -> None:
    peg = _peg("round")
    bore = Polygon(HoleDrawing(clearance_m=1e-4).shape(peg).outline.corners_m)
    for turn in np.linspace(0.0, 0.2, 21):
        rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        left = bore.exterior.distance(Polygon(peg.outline.corners_m @ rotation))
        assert 0.0525e-3 < left < 0.1001e-3


def test_tips_fit_off_centre_and_turned_into_the_largest_circle() -> None:
    for name in OUTLINES:
        peg = _peg(name)
        tip_radius = float(np.max(np.hypot(*peg.outline_m(peg.tip_m)[:, :2].T)))
        assert tip_radius < peg.outline.inner_radius_m - 0.0046


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        ([(0.01, 0.0), (0.0, 0.01)], "three corners"),
        ([(0.01, 0.01), (-0.01, -0.01), (0.01, -0.01), (-0.01, 0.01)], "cross or touch itself"),
        ([(0.01, 0.01), (0.02, 0.01), (0.02, 0.02)], "axis"),
        ([(0.01, 0.0), (0.01, 1e-8), (-0.01, 0.01), (-0.01, -0.01)], "coincide"),
    ],
)
def test_impossible_outlines_are_refused(corners: list[tuple[float, float]], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Outline.of("wrong", corners)


def test_a_chamfer_wider_than_a_detail_is_refused() -> None:
    narrow = [(-20, -20), (20, -20), (20, 20), (0.5, 20), (0.5, 8), (-0.5, 8), (-0.5, 20), (-20, 20)]
    outline = Outline.of("narrow", np.array(narrow) * 1e-3)
    with pytest.raises(ValueError, match="smaller clearance or chamfer"):
        Hole(outline, 0.001)
    assert Hole(outline, 0.0003).pieces()


def test_a_star_has_as_many_spikes_as_asked_for() -> None:
    assert PegDrawing(outline="star", count=7).shape().outline.symmetry_order == 7
    assert len(star(7, 0.027, 0.013)) == 14


def test_a_plate_that_bulges_into_the_hole_is_cut() -> None:
    """An arc of eight chords on the plate's side, whose lines are all needed behind each of them."""
    rise = 15.0 - np.array([0.03, 0.124, 0.406, 0.876, 1.529])
    y = np.array([0.0, 2.535, 5.056, 7.549, 10.0])
    left = [[-30.0 + x, -height] for x, height in zip(rise, y, strict=True)]
    wall = [[x, -height] for x, height in left[::-1]] + left[1:]
    outline = Outline.of("bulge", np.array([*wall, [13.471, -10.0], [16.4, 0.0], [13.471, 10.0]]) * 1e-3)
    _assert_hole_is_exact(Hole(outline.grown(1e-4)), 500, 6)
