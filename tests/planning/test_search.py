"""Finding a hole by feel: the geometry by itself, for outlines of any kind."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.geometry import Pose, wrench_of_force_at_point
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import CrossHole, CrossPeg
from services.planning.search import FaceContact, FacePlane, HoleBelief, OutlineField, face_contact
from services.planning.search.belief import around_m, pose_prior
from services.planning.search.outline_field import inside_m

HALF_RANGES = np.array([0.01, 0.01, 0.015, 0.1, 0.1, 0.1])
PEG = CrossPeg()
TIP_M = PEG.outline_m(PEG.tip_m)


def regular(corners: int, radius_m: float) -> Array:
    angles = 2.0 * np.pi * np.arange(corners) / corners
    return radius_m * np.column_stack([np.cos(angles), np.sin(angles)])


def star(radius_m: float) -> Array:
    corners = regular(10, radius_m)
    corners[1::2] *= 0.5
    return corners


OUTLINES = {
    "cross": CrossHole().inner_rim_m()[:, :2],
    "triangle": regular(3, 0.025),
    "square": regular(4, 0.022),
    "hexagon": regular(6, 0.02),
    "round": regular(48, 0.018),
    "star": star(0.025),
}


def turned(points_m: Array, turn_rad: float) -> Array:
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    return np.asarray(points_m @ np.array([[cos, sin], [-sin, cos]]))


def test_inside_of_a_square() -> None:
    square = np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
    points = np.array([[0.0, 0.0], [0.5, 0.0], [2.0, 0.0], [2.0, 2.0]])
    assert inside_m(square, points) == pytest.approx([1.0, 0.5, -1.0, -np.sqrt(2.0)])


@pytest.mark.parametrize("name", OUTLINES)
def test_the_field_is_the_outline(name: str) -> None:
    outline = OUTLINES[name]
    field = OutlineField.of(outline, 0.025)
    points = np.random.default_rng(3).uniform(-0.025, 0.025, (500, 2))
    # bilinear, so that near the corners' bisectors it is off by up to a fraction of its 0.25 mm
    assert np.abs(field.inside_m(points) - inside_m(outline, points)).max() < 1.5e-4


TILTS = st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))


@given(corner=st.integers(0, 11), tilt=TILTS, friction=st.floats(0.0, 0.15), azimuth=st.floats(0.0, 6.3))
def test_a_tip_on_the_face_is_known(corner: int, tilt: tuple[float, float], friction: float, azimuth: float) -> None:
    normal = Pose.from_rotvec([*tilt, 0.0], np.zeros(3)).rotation[:, 2]
    across = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    across -= normal * (across @ normal)
    wrench = wrench_of_force_at_point(-6.0 * (normal - friction * across), TIP_M[corner])
    contact = face_contact(TIP_M, Pose.identity(), wrench)
    assert contact is not None and contact.at_corner
    assert contact.point_m == pytest.approx(TIP_M[corner], abs=1e-9)


@given(corner=st.integers(0, 11), share=st.floats(0.05, 1.0), azimuth=st.floats(0.0, 6.3))
def test_a_wall_is_not_the_face(corner: int, share: float, azimuth: float) -> None:
    """The taper's sides lean by 14 degrees and its arms' ends by 37: their forces lie far from the axis."""
    tip_ends, body_ends = PEG.taper_edges_m()
    place = tip_ends[corner] + share * (body_ends[corner] - tip_ends[corner])
    lean = np.arctan(3.0 * PEG.taper_slope) + 0.1
    force = 6.0 * np.array([np.cos(azimuth) * np.cos(lean), np.sin(azimuth) * np.cos(lean), -np.sin(lean)])
    assert face_contact(TIP_M, Pose.identity(), wrench_of_force_at_point(force, place)) is None


def test_a_push_beside_the_tip_is_not_the_face() -> None:
    """Two walls at once can push along the axis, but not through the tip."""
    assert face_contact(TIP_M, Pose.identity(), wrench_of_force_at_point([0, 0, -8.0], [0.02, 0.0, 0.06])) is None


@given(tilt=TILTS, depth_m=st.floats(-0.015, 0.015))
def test_three_contacts_make_the_plane(tilt: tuple[float, float], depth_m: float) -> None:
    truth = Pose.from_rotvec([*tilt, 0.0], [0.0, 0.0, depth_m])
    plane = FacePlane.from_half_ranges(HALF_RANGES)
    for x, y in ((0.01, 0.0), (-0.008, 0.009), (-0.004, -0.01)):
        plane = plane.with_point(truth.apply([x, y, 0.0]))
    pose = plane.pose(0.0, 0.0)
    assert abs(plane.depth_m(truth.translation_m)[0]) < 2e-4
    assert np.arccos(np.clip(pose.rotation[:, 2] @ truth.rotation[:, 2], -1.0, 1.0)) < 0.012


def tip_of(outline_m: Array) -> Array:
    return 0.28 * outline_m


@settings(max_examples=10, deadline=None)
@given(
    name=st.sampled_from(sorted(OUTLINES)),
    x=st.floats(-0.01, 0.01),
    y=st.floats(-0.01, 0.01),
    turn=st.floats(-0.1, 0.1),
    which=st.floats(0.0, 0.999),
)
def test_probes_find_the_hole(name: str, x: float, y: float, turn: float, which: float) -> None:
    """Ideal contacts on a plane: some corner of the tip that is beside the hole touches; when none is, it is in."""
    rim, tip = 1.04 * OUTLINES[name], tip_of(OUTLINES[name])
    belief = HoleBelief.uniform(rim, tip, HALF_RANGES)
    for probe in range(12):  # noqa: B007
        place, probe_turn, chance = belief.best_probe()
        at = turned(around_m(tip), probe_turn) + place
        inside = inside_m(rim, turned(at - [x, y], -turn))
        beside = np.flatnonzero(inside < 0.0)
        if len(beside) == 0:
            belief = belief.after_entry(at)
            break
        touched = at[beside[int(which * len(beside))]]
        belief = belief.after_face(FaceContact(np.array([*touched, 0.0]), at_corner=True))
        assert 0.0 < chance <= 1.0
    else:
        pytest.fail("not found")
    assert probe < 10
    # The tip fits into an arm of a cross or a star too: what is left can be several places, so mean and covariance
    # say little of the truth. It must still be among them.
    off = (belief.cells - [x, y, turn]) / np.ptp(belief.cells, axis=0)
    assert belief.weights[np.argmin((off**2).sum(axis=1))] > 0.02 * belief.weights.max()


def test_a_rim_contact_says_more_than_a_corner() -> None:
    belief = HoleBelief.uniform(CrossHole().outer_rim_m(), TIP_M, HALF_RANGES)
    point = np.array([0.003, 0.002, 0.0])
    corner = belief.after_face(FaceContact(point, True)).covariance()
    rim = belief.after_face(FaceContact(point, False)).covariance()
    assert np.linalg.det(rim) < np.linalg.det(corner) < np.linalg.det(belief.covariance())


def test_the_prior_of_both_beliefs() -> None:
    belief = HoleBelief.uniform(CrossHole().outer_rim_m(), TIP_M, HALF_RANGES)
    pose, covariance = pose_prior(belief, FacePlane.from_half_ranges(HALF_RANGES))
    assert np.abs(pose.translation_m).max() < 1e-9 and np.abs(pose.rotvec_rad()).max() < 1e-9
    assert np.sqrt(np.diag(covariance)) == pytest.approx(HALF_RANGES / np.sqrt(3.0), rel=0.05)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
