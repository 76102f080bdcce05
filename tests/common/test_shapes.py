"""Peg and hole: exact pieces, rims and edges."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import ConvexPiece, CrossPeg

PEG = CrossPeg()
HOLE = PEG.hole(1e-4)


def _inside(pieces: list[ConvexPiece], points: Array) -> Array:
    return np.asarray(np.any([piece.contains(points, -1e-12) for piece in pieces], axis=0))


def test_the_default_peg_is_the_one_the_paper_used() -> None:
    assert PEG.taper_start_m == pytest.approx(0.0537)
    assert PEG.tip_m == pytest.approx(0.0797)
    assert PEG.half_width_at_m(0.0897 - 0.02) == pytest.approx(0.005)


def test_peg_pieces_are_the_tapered_cross() -> None:
    points = np.random.default_rng(1).uniform([-0.03, -0.03, 0.0], [0.03, 0.03, 0.09], (20000, 3))
    width = PEG.half_width_at_m(points[:, 2])
    length = width * PEG.length_ratio
    x, y = np.abs(points[:, 0]), np.abs(points[:, 1])
    cross = ((x < width) & (y < length)) | ((x < length) & (y < width))
    cross &= (points[:, 2] > PEG.body_start_m) & (points[:, 2] < PEG.tip_m)
    assert np.array_equal(_inside(PEG.pieces(), points), cross)


def test_hole_pieces_leave_the_chamfered_cross_open() -> None:
    size = HOLE.plate_half_size_m
    points = np.random.default_rng(2).uniform([-size, -size, 0.0], [size, size, HOLE.depth_m], (40000, 3))
    wider = np.maximum(0.0, HOLE.chamfer_m - points[:, 2])
    width, length = HOLE.half_width_m + wider, HOLE.half_length_m + wider
    x, y = np.abs(points[:, 0]), np.abs(points[:, 1])
    opening = ((x < width) & (y < length)) | ((x < length) & (y < width))
    assert np.array_equal(_inside(HOLE.pieces(), points), ~opening)


def test_rims_and_edges_lie_on_the_shapes() -> None:
    assert np.allclose(HOLE.outer_rim_m()[:, 2], 0.0)
    assert np.allclose(HOLE.inner_rim_m()[:, 2], HOLE.chamfer_m)
    tips, bodies = PEG.taper_edges_m()
    apex = np.array([0.0, 0.0, PEG.apex_m])
    # every taper edge points at the apex
    assert np.allclose(np.cross(tips - apex, bodies - apex), 0.0, atol=1e-12)


def test_inset_moves_every_face_by_the_margin() -> None:
    for piece in PEG.pieces() + HOLE.pieces():
        smaller = piece.inset(1e-4)
        gaps = piece.offsets_m - np.max(smaller.vertices_m() @ piece.normals.T, axis=0)
        assert np.all(gaps > 1e-4 - 1e-12)
        assert np.min(gaps) == pytest.approx(1e-4, abs=1e-12)


@pytest.mark.parametrize(
    "wrong", [{"half_width_m": 0.03}, {"taper_slope": -1.0}, {"tip_half_width_m": 0.02}, {"body_start_m": 0.06}]
)
def test_impossible_pegs_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="a cross peg wants"):
        CrossPeg(**wrong)
