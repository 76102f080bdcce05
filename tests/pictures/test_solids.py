"""The rim as it is made, against the drawing."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.config import Workcell
from services.operator.bench.pictures.kept.sets import OUTLINES
from services.operator.bench.pictures.scenes.targets import hole_of
from services.operator.bench.pictures.tracing.solids import SolidRim, box_solid, disc, prism

HOLE = hole_of(Workcell(), "cross")


def test_without_a_broken_edge_the_rim_is_the_drawings() -> None:
    edge, bore = SolidRim(HOLE.outline, HOLE.chamfer_m, 0.0).strips(0.03)
    corners = {tuple(np.round(corner, 9)) for corner in edge.vertices_m}
    assert corners == {tuple(np.round(corner, 9)) for corner in (*HOLE.outer_rim_m(), *HOLE.inner_rim_m())}
    assert bore.vertices_m[:, 2].max() == pytest.approx(0.03)


@pytest.mark.parametrize("outline", ["cross", *OUTLINES])
def test_a_broken_edge_opens_the_face_by_its_tangent(outline: str) -> None:
    hole = hole_of(Workcell(), outline)
    rim = SolidRim(hole.outline, hole.chamfer_m, 0.2e-3)
    edge, bore = rim.strips(0.03)
    drawn, made = hole.opening().area_m2, rim.opening().area
    length = np.sum(
        np.linalg.norm(np.diff(hole.opening().corners_m, axis=0, append=hole.opening().corners_m[:1]), axis=1)
    )
    assert (made - drawn) / length == pytest.approx(0.2e-3 * np.tan(np.pi / 8.0), rel=0.05)
    assert edge.vertices_m[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert edge.vertices_m[:, 2].max() == pytest.approx(hole.chamfer_m + 0.2e-3 * np.tan(np.pi / 8.0))
    # every triangle's winding agrees with its normals, towards the cameras or into the hole
    for solid in (edge, bore):
        a, b, c = (solid.vertices_m[solid.faces[:, k]] for k in range(3))
        turned = np.cross(b - a, c - a)
        assert len({bool(sign) for sign in np.sum(turned * solid.normals[solid.faces[:, 0]], axis=1) > 0.0}) == 1


def test_a_prism_is_closed() -> None:
    for solid in (box_solid((0.01, 0.02, 0.03)), prism(disc(0.02) - disc(0.01), 0.0, 0.01)):
        a, b, c = (solid.vertices_m[solid.faces[:, k]] for k in range(3))
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        assert np.allclose(area @ solid.normals[solid.faces[:, 0]], 0.0, atol=1e-9)
