"""First contacts of pegs of any section against the plain separating-axis test, and against the features that show."""

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.geometry import rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from services.inference.mechanics import PairTables, SurfacePair, contact_geometry, first_contact, first_contacts
from services.inference.mechanics.polyhedron import Polyhedron, arc_arc_angle, arc_point_angle
from services.inference.mechanics.separating_axes import AxisTables, first_contacts_by_axes

SHAPES = ("cross", "square", "triangle", "hexagon", "star")
TOUCHING_M = 1e-8


def tables_of(name: str) -> tuple[PairTables, float]:
    """The tables of a named peg in its hole, and how far its tip is ahead, m."""
    cell = Workcell.model_validate({} if name == "cross" else {"peg": {"outline": name}})
    peg = cell.peg.shape()
    return PairTables.of(peg, cell.hole.shape(peg)), peg.tip_m


def poses(tip_m: float, count: int, turn_rad: float, deepest_m: float) -> tuple[Array, Array, Array]:
    """Poses from 20 mm before the hole to some depth inside it, and motions mostly along the axis."""
    rng = np.random.default_rng(0)
    rotation = np.swapaxes(rotation_from_error_angles(rng.uniform(-turn_rad, turn_rad, (count, 3))), 1, 2)
    tip = np.column_stack([rng.uniform(-0.01, 0.01, (count, 2)), rng.uniform(-0.02, deepest_m, count)])
    motion = np.column_stack([rng.uniform(-0.1, 0.1, (count, 2)), np.ones(count)])
    motion /= np.linalg.norm(motion, axis=1, keepdims=True)
    return rotation, tip - rotation @ np.array([0.0, 0.0, tip_m]), motion


# 0.1 rad and 0.3 rad are in different tables; 0.8 rad is in the one without pruning.
@pytest.mark.parametrize("turn_rad", [0.1, 0.3, 0.8])
@pytest.mark.parametrize("name", SHAPES)
def test_first_contacts_are_those_of_every_axis(name: str, turn_rad: float) -> None:
    """Same travel of the first contact, same depth of every pair that overlaps."""
    tables, tip_m = tables_of(name)
    where = poses(tip_m, 40, turn_rad, 0.01)
    plain = first_contacts_by_axes(AxisTables.of(tables), *where)
    found = first_contacts(tables, *where)
    assert found.travel_m.min(axis=1) == pytest.approx(plain.travel_m.min(axis=1), abs=1e-9)
    overlapping = plain.separation_m < 0.0
    assert np.any(overlapping)
    assert found.separation_m[overlapping] == pytest.approx(plain.separation_m[overlapping], abs=1e-9)
    assert np.array_equal(found.separation_m < 0.0, overlapping)


@pytest.mark.parametrize("name", SHAPES)
def test_the_first_of_all_is_the_first_of_the_pairs(name: str) -> None:
    """And its features have no gap at the travel, with a normal against the motion."""
    tables, tip_m = tables_of(name)
    rotation, translation, motion = poses(tip_m, 200, 0.1, -0.001)
    first = first_contact(tables, rotation, translation, motion)
    pairs = first_contacts(tables, rotation, translation, motion)
    assert np.array_equal(first.travel_m, pairs.travel_m.min(axis=1))
    assert np.array_equal(first.pair, pairs.travel_m.argmin(axis=1))
    assert np.all(np.isfinite(first.travel_m))
    geometry = contact_geometry(first.features, rotation, translation + first.travel_m[:, None] * motion)
    assert geometry.gap_m == pytest.approx(np.zeros(200), abs=1e-12)
    assert np.all(np.einsum("nij,nj,ni->n", rotation, geometry.normal_peg, motion) < 0.0)


@pytest.mark.parametrize("name", SHAPES)
def test_what_touches_first_shows_on_the_surface(name: str) -> None:
    """Every first contact is between features of the surfaces, nothing inside another piece makes one."""
    tables, tip_m = tables_of(name)
    rotation, translation, motion = poses(tip_m, 200, 0.1, -0.001)
    travel = first_contact(tables, rotation, translation, motion).travel_m
    surfaces = SurfacePair.of(tables)
    near = surfaces.near(rotation, translation + travel[:, None] * motion, np.full(200, 5e-5), 8)
    assert np.all((np.abs(near.gap_m) < TOUCHING_M).any(axis=1))
    assert np.all(near.gap_m > -1e-6)
    assert np.mean((np.abs(near.gap_m) < TOUCHING_M).sum(axis=1)) < 1.02
    # One step back, all of it is gone.
    clear = surfaces.near(rotation, translation + (travel - 1e-3)[:, None] * motion, np.full(200, 1e-4), 8)
    assert np.all(clear.gap_m > 0.0)


def test_a_surface_has_the_edges_that_a_drawing_has() -> None:
    """The cross: 8 outer edges along the taper, 8 along the body, 12 round the taper's start, 12 round the tip."""
    surfaces = SurfacePair.of(tables_of("cross")[0])
    assert len(surfaces.peg.edge_halves_m) == 40
    # Both rims, and at the 4 corners that turn into the hole an edge along the bore and one along the chamfer.
    assert len(surfaces.hole.edge_halves_m) == 32
    hexagon = SurfacePair.of(tables_of("hexagon")[0])
    assert (len(hexagon.peg.edge_halves_m), len(hexagon.hole.edge_halves_m)) == (24, 12)


def test_a_peg_that_passes_touches_nothing() -> None:
    """Moving away from the plate, and past it."""
    tables, tip_m = tables_of("cross")
    rotation, translation, motion = poses(tip_m, 20, 0.1, -0.001)
    assert np.all(np.isinf(first_contact(tables, rotation, translation, -motion).travel_m))
    sideways = np.tile([1.0, 0.0, 0.0], (20, 1))
    assert np.all(np.isinf(first_contact(tables, rotation, translation - [0.0, 0.0, 0.05], sideways).travel_m))


def test_tables_say_when_a_peg_is_turned_too_far() -> None:
    """The surfaces are tabulated for a cone of rotations."""
    tables, tip_m = tables_of("square")
    rotation, translation, _ = poses(tip_m, 5, 0.4, -0.001)
    with pytest.raises(ValueError, match="larger cone_rad"):
        SurfacePair.of(tables, cone_rad=0.05).near(rotation, translation, np.full(5, 1e-4), 4)


def test_arcs_of_the_sphere() -> None:
    """Known angles, and never more than what sampling the arcs finds."""
    x, y, z = np.eye(3)
    assert arc_arc_angle(x, y, z, (x + y) / np.sqrt(2.0)) == pytest.approx(0.0, abs=1e-9)
    assert arc_arc_angle(x, y, z, -x) == pytest.approx(np.pi / 2)
    assert arc_point_angle(x, y, z) == pytest.approx(np.pi / 2)
    rng = np.random.default_rng(1)
    corners = rng.normal(size=(4, 50, 3))
    a, b, c, d = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    share = np.linspace(0.0, 1.0, 200)[:, None, None]
    one, other = a + share * (b - a), c + share * (d - c)
    one, other = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (one, other))
    sampled = np.arccos(np.clip(np.einsum("ski,tki->stk", one, other), -1.0, 1.0)).min(axis=(0, 1))
    exact = arc_arc_angle(a, b, c, d)
    assert np.all(exact <= sampled + 1e-9) and np.all(exact > sampled - 0.03)


def test_a_hull_of_corners_is_its_piece() -> None:
    """A bar of the cross from its planes and from its corners."""
    solid = tables_of("cross")[0].peg[0]
    again = Polyhedron.hull(solid.corners_m)
    assert len(again.normals) == len(solid.normals) == 10
    assert len(again.edges) == len(solid.edges) == 20
