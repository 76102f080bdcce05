"""The contact mechanics against the paper's numbers, against itself moved, and against properties of forces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose, rotation_from_error_angles, wrench_of_force_at_point
from crosspih_common.shapes import CrossPeg
from services.inference.mechanics import (
    PairTables,
    axial_share,
    contact_geometry,
    contact_wrench_basis,
    first_contacts,
)
from services.inference.mechanics.contact_wrench import equal_arms_axial_share
from services.inference.mechanics.translation import solve_translation
from tests.paper_tables import FIRST_CONTACT, FITTED_APEX_M, FITTED_SLOPE, TABLE_6, TABLE_7_RAD

PEG = CrossPeg()
HOLE = PEG.hole(1e-4)
TABLES = PairTables.of(PEG, HOLE)
ALONG = np.array([0.0, 0.0, 1.0])
TAPER_EDGE = np.array([-FITTED_SLOPE, -3 * FITTED_SLOPE, 1.0])
# Parallel edges touch along lines, and an aligned peg not at all: stay off zero.
small = st.floats(0.002, 0.1) | st.floats(-0.1, -0.002)
millimetres = st.floats(-0.004, 0.004)


def moment_residual_nm(wrench: np.ndarray) -> float:
    """How far a wrench's moment is from that of its force at the best point of the +y arm's taper edge."""
    apex = np.array([0.0, 0.0, FITTED_APEX_M])
    rest = wrench[3:] - np.cross(apex, wrench[:3])
    turn = np.cross(TAPER_EDGE, wrench[:3])
    return float(np.linalg.norm(rest - turn * (turn @ rest) / (turn @ turn)))


def first_touch(pose_hole_peg: Pose, direction: np.ndarray, mu: float = 0.0) -> tuple[float, np.ndarray]:
    """Travel and wrench of 1 N of normal force at the first contact."""
    pairs = first_contacts(TABLES, pose_hole_peg.rotation[None], pose_hole_peg.translation_m[None], direction[None])
    first = int(pairs.travel_m[0].argmin())
    travel = float(pairs.travel_m[0, first])
    shift = pose_hole_peg.translation_m + travel * direction
    geometry = contact_geometry(pairs.features[0, first], pose_hole_peg.rotation, shift)
    motion = pose_hole_peg.rotation.T @ direction
    return travel, contact_wrench_basis(geometry.normal_peg, geometry.point_peg_m, motion, mu)


def peg_above(angles: np.ndarray, xy: np.ndarray) -> Pose:
    """The peg in the hole frame with its tip's centre 10 mm short of the outer face."""
    rotation = rotation_from_error_angles(angles).T
    return Pose(rotation, np.array([xy[0], xy[1], -0.01]) - rotation @ np.array([0.0, 0.0, PEG.tip_m]))


def test_table_6_is_the_taper_edge_on_the_rim() -> None:
    """Force directions n = M1N1 x D1D2 (Eqs. 18-19) to 4e-4 rad, moments to 1.3 mNm (rms a component)."""
    rim = rotation_from_error_angles(TABLE_7_RAD)[:, :, 1]
    normal = -np.cross(TAPER_EDGE, rim)
    normal *= np.sign(np.einsum("ni,ni->n", normal, TABLE_6[:, :3]))[:, None]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    direction = TABLE_6[:, :3] / np.linalg.norm(TABLE_6[:, :3], axis=1, keepdims=True)
    off = np.linalg.norm(normal - direction, axis=1)
    assert np.sqrt(np.mean(off**2) / 2.0) < 4.2e-4
    residuals = np.array([moment_residual_nm(row) for row in TABLE_6])
    assert np.sqrt(np.mean(residuals**2) / 3.0) < 1.3e-3


def test_first_contact_of_the_experiment() -> None:
    """One pure force through the +y arm's taper edge, 64.6 mm ahead."""
    assert abs(FIRST_CONTACT[:3] @ FIRST_CONTACT[3:]) < 0.01
    angle = FIRST_CONTACT[:3] @ TAPER_EDGE / np.linalg.norm(FIRST_CONTACT[:3]) / np.linalg.norm(TAPER_EDGE)
    assert abs(angle) < 2e-3
    assert moment_residual_nm(FIRST_CONTACT) < 5e-3


def test_axial_shares_of_equal_arms() -> None:
    """n_z0 of 1 to 4 arms that press equally, from Table 6's forces: the paper prints .278, .376, .649, 1."""
    ratio = np.abs(TABLE_6[:, 2]) / np.linalg.norm(TABLE_6[:, :2], axis=1)
    shares = [float(np.mean(equal_arms_axial_share(ratio, arms))) for arms in (1, 2, 3, 4)]
    assert shares[0] == pytest.approx(float(np.mean(axial_share(TABLE_6[:, :3]))))
    assert shares == pytest.approx([0.278, 0.382, 0.660, 1.0], abs=0.01)
    with pytest.raises(ValueError, match="1 to 4"):
        equal_arms_axial_share(ratio, 5)


def test_one_contact_tells_exactly_two_numbers() -> None:
    """The map (alpha, beta, gamma, x, y) to a single contact's wrench has rank 2."""
    centre = np.array([0.05, 0.03, 0.04, 0.0012, 0.0008])

    def wrench(parameters: np.ndarray) -> np.ndarray:
        _, found = first_touch(peg_above(parameters[:3], parameters[3:]), np.array([0.0, 0.0, 1.0]))
        return np.asarray(found / np.linalg.norm(found[:3]) * np.array([1, 1, 1, 20, 20, 20]))

    step = 1e-6
    columns = [(wrench(centre + step * e) - wrench(centre - step * e)) / (2 * step) for e in np.eye(5)]
    values = np.linalg.svd(np.array(columns).T, compute_uv=False)
    assert values[1] > 1e-2 * values[0]
    assert values[2] < 1e-6 * values[0]


@settings(max_examples=30, deadline=None)
@given(st.tuples(small, small, small), st.tuples(millimetres, millimetres))
def test_single_frictionless_contact_is_a_pure_force(
    angles: tuple[float, float, float], xy: tuple[float, float]
) -> None:
    """M . F = 0, the force is a unit normal that opposes the motion."""
    travel, wrench = first_touch(peg_above(np.array(angles), np.array(xy)), ALONG)
    assert 0.0 < travel < 0.1
    assert abs(wrench[:3] @ wrench[3:]) < 1e-12
    assert np.linalg.norm(wrench[:3]) == pytest.approx(1.0)
    rotation = rotation_from_error_angles(np.array(angles))
    assert wrench[:3] @ (rotation @ ALONG) < 0.0


@settings(max_examples=30, deadline=None)
@given(st.tuples(small, small, small), st.tuples(millimetres, millimetres), st.floats(0.0, 0.3))
def test_friction_stays_in_its_cone_and_costs_no_moment_about_the_point(
    angles: tuple[float, float, float], xy: tuple[float, float], mu: float
) -> None:
    """The friction force is mu times the normal force where it slides, less where it sticks; still one force."""
    pose = peg_above(np.array(angles), np.array(xy))
    _, plain = first_touch(pose, ALONG)
    _, rubbed = first_touch(pose, ALONG, mu)
    assert np.linalg.norm(rubbed[:3] - plain[:3]) <= mu + 1e-9
    assert abs(rubbed[:3] @ rubbed[3:]) < 1e-12
    # It takes power from the motion along the plane.
    assert (rubbed[:3] - plain[:3]) @ (pose.rotation.T @ ALONG) <= 1e-12


@settings(max_examples=20, deadline=None)
@given(st.tuples(small, small, small), st.tuples(millimetres, millimetres), st.floats(1e-4, 8e-3))
def test_travel_counts_down(angles: tuple[float, float, float], xy: tuple[float, float], ahead: float) -> None:
    """Starting a little further on shortens the travel by just that, and leaves the wrench."""
    pose = peg_above(np.array(angles), np.array(xy))
    travel, wrench = first_touch(pose, ALONG)
    nearer, same = first_touch(Pose(pose.rotation, pose.translation_m + ahead * ALONG), ALONG)
    assert nearer == pytest.approx(travel - ahead, abs=1e-9)
    assert same == pytest.approx(wrench, abs=1e-6)


def test_quarter_turns_of_everything_turn_the_wrench() -> None:
    """Peg and hole are the same after a quarter turn: the wrench turns with them."""
    pose = peg_above(np.array([0.03, -0.04, 0.05]), np.array([0.0011, -0.0007]))
    travel, wrench = first_touch(pose, ALONG)
    quarter = Rotation.from_rotvec([0.0, 0.0, np.pi / 2]).as_matrix()
    turned = Pose(quarter @ pose.rotation @ quarter.T, quarter @ pose.translation_m)
    again, other = first_touch(turned, ALONG)
    assert again == pytest.approx(travel, abs=1e-9)
    assert other == pytest.approx(np.concatenate([quarter @ wrench[:3], quarter @ wrench[3:]]), abs=1e-6)


def test_bodies_only_touch_at_the_travel() -> None:
    """At first contact no peg corner is inside the hole's pieces and none of theirs inside the peg's."""
    rng = np.random.default_rng(3)
    for _ in range(40):
        pose = peg_above(rng.uniform(-0.1, 0.1, 3), rng.uniform(-0.006, 0.006, 2))
        travel, _ = first_touch(pose, ALONG)
        touching = Pose(pose.rotation, pose.translation_m + travel * ALONG)
        for peg_piece in PEG.pieces():
            for hole_piece in HOLE.pieces():
                assert not np.any(hole_piece.contains(touching.apply(peg_piece.vertices_m()), slack_m=-1e-8))
                assert not np.any(peg_piece.contains(touching.inverse().apply(hole_piece.vertices_m()), slack_m=-1e-8))


def test_translation_from_known_angles() -> None:
    """The paper's last step: with exact angles one wrench narrows x and y to what explains it."""
    angles = np.array([0.05, 0.03, 0.04])
    rim = np.array([0.0012, 0.0008, 0.06])
    pose = Pose(rotation_from_error_angles(angles), rim).inverse()
    motion = pose.rotation @ ALONG
    _, wrench = first_touch(pose, motion)
    found, cost = solve_translation(TABLES, angles, 20.0 * wrench, rim_ahead_m=0.06)
    assert cost < 1e-2
    again = Pose(rotation_from_error_angles(angles), found).inverse()
    _, same = first_touch(again, again.rotation @ ALONG)
    assert same == pytest.approx(wrench, abs=2e-3)


def test_eq_24_is_r_cross_f() -> None:
    """Mx = -Fy Bz + Fz By, My = Fx Bz - Fz Bx, Mz = -Fx By + Fy Bx."""
    (fx, fy, fz), (bx, by, bz) = np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3])
    expected = [fx, fy, fz, -fy * bz + fz * by, fx * bz - fz * bx, -fx * by + fy * bx]
    assert wrench_of_force_at_point([fx, fy, fz], [bx, by, bz]) == pytest.approx(expected)
