"""Distances against closed forms and against bounded least squares, which shares nothing with the library."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from crosspih_common.collision import CollisionModel, Fixture
from crosspih_common.collision.fixture import plate_corners_m
from crosspih_common.collision.moving import MovingPart, moving_parts
from crosspih_common.config import HolePrior, Surroundings, Workcell
from crosspih_common.config.surroundings import Box, Cylinder
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

CELL = Workcell()
HOME = np.asarray(CELL.home_joints_rad)
PARTS = {part.name: part for part in moving_parts(CELL)}
SUM_WEIGHT = 1e4
ANGLE = st.floats(-1.0, 1.0)


def cell_with(**surroundings: object) -> CollisionModel:
    return CollisionModel(Workcell(surroundings=Surroundings.model_validate(surroundings)))


def placed(part: MovingPart, joints: Array) -> Pose:
    return CELL.arm().link_poses(joints)[part.frame] @ part.pose_frame_part


def least_between(points_m: Array, box: Box) -> float:
    """The distance of the hull of points (k, 3) from a box, m, 0 where they overlap: convex, so one least square."""
    pose, half = box.pose(), np.asarray(box.size_m) / 2
    count = len(points_m)
    rows = np.zeros((4, count + 3))
    rows[:3, :count], rows[:3, count:] = points_m.T, -pose.rotation
    rows[3, :count] = SUM_WEIGHT
    low = np.concatenate([np.zeros(count), -half])
    high = np.concatenate([np.ones(count), half])
    aim = np.append(pose.translation_m, SUM_WEIGHT)
    return float(np.sqrt(2.0 * lsq_linear(rows, aim, (low, high), method="bvls", tol=1e-14).cost))


def corners_of(part: MovingPart) -> tuple[Array, float]:
    """Points whose hull, grown by a radius, is the part (a cylinder by 90 corners on each rim)."""
    if part.corners_m is not None:
        return part.corners_m, 0.0
    ends = np.array([[0.0, 0.0, -part.length_m / 2], [0.0, 0.0, part.length_m / 2]])
    if part.round_ends:
        return ends, part.radius_m
    turn = np.linspace(0.0, 2 * np.pi, 90, endpoint=False)
    rim = part.radius_m * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(90)])
    return np.vstack([rim + ends[0], rim + ends[1]]), 0.0


def test_distances_known_in_closed_form() -> None:
    # at zero the upper arm (link 2) stands upright at x = 0.04 from z = 0.342 to 0.617; the wrist (link 5) is a ball
    box = Box(name="box", size_m=(0.2, 0.2, 0.1), position_m=(-0.3, 0.0, 0.48))
    upright = Cylinder(name="upright", radius_m=0.05, length_m=0.1, position_m=(0.04, 0.4, 0.5))
    found = cell_with(boxes=[box], cylinders=[upright], floor_height_m=0.02).distances_m(np.zeros(6))
    radius = {name: part.radius_m for name, part in PARTS.items()}
    wrist = placed(PARTS["arm link 5"], np.zeros(6)).translation_m
    assert found["arm link 2", "box"] == pytest.approx(0.24 - radius["arm link 2"], abs=1e-9)
    assert found["arm link 2", "upright"] == pytest.approx(0.4 - 0.05 - radius["arm link 2"], abs=1e-6)
    assert found["arm link 5", "the floor"] == pytest.approx(wrist[2] - 0.02 - radius["arm link 5"], abs=1e-9)
    beyond = np.maximum(np.abs(wrist - [-0.3, 0.0, 0.48]) - [0.1, 0.1, 0.05], 0.0)
    assert found["arm link 5", "box"] == pytest.approx(np.linalg.norm(beyond) - radius["arm link 5"], abs=1e-9)
    assert ("arm link 1", "the floor") not in found  # it stands on it


def test_an_overlap_is_as_deep_as_it_is() -> None:
    box = Box(
        name="box", size_m=(0.2, 0.2, 0.1), position_m=(-0.04, 0.0, 0.48)
    )  # its face 20 mm past the link's middle
    found = cell_with(boxes=[box]).distances_m(np.zeros(6))["arm link 2", "box"]
    assert found == pytest.approx(-(PARTS["arm link 2"].radius_m + 0.02), abs=1e-6)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_random_boxes_are_as_far_as_bounded_least_squares_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    joints = HOME + rng.uniform(-0.8, 0.8, 6)
    box = Box(
        name="box",
        size_m=tuple(rng.uniform(0.02, 0.5, 3)),
        position_m=tuple(rng.uniform(-0.8, 0.8, 3)),
        rotvec_rad=tuple(rng.uniform(-2.0, 2.0, 3)),
    )
    found = cell_with(boxes=[box]).distances_m(joints)
    for name, part in PARTS.items():
        corners, radius = corners_of(part)
        witness = least_between(placed(part, joints).apply(corners), box)
        if witness > 1e-4:
            assert found[name, "box"] == pytest.approx(witness - radius, abs=5e-5), name
        else:
            assert found[name, "box"] < 2e-4 - radius, name


@settings(max_examples=25, deadline=None)
@given(turn=st.floats(-1.0, 1.0), joints=st.tuples(ANGLE, ANGLE, ANGLE, ANGLE, ANGLE, ANGLE))
def test_turning_the_arm_and_all_around_it_together_changes_no_distance(turn: float, joints: tuple[float, ...]) -> None:
    around = Pose.from_rotvec([0.0, 0.0, turn], [0.0, 0.0, 0.0])

    def cell(pose: Pose) -> CollisionModel:
        box, tank = (
            pose @ Pose.from_rotvec([0.2, 0.4, 0.1], [0.3, 0.3, 0.3]),
            pose @ Pose.from_translation([0.4, 0.1, 0.6]),
        )
        hole = (pose @ CELL.hole_prior.pose_base_hole()).matrix()[:3]
        where = [{"position_m": p.translation_m.tolist(), "rotvec_rad": p.rotvec_rad().tolist()} for p in (box, tank)]
        return CollisionModel(
            Workcell(
                hole_prior=HolePrior(matrix_base_hole=tuple(map(tuple, hole.tolist()))),
                surroundings=Surroundings.model_validate(
                    {
                        "boxes": [{"name": "box", "size_m": [0.2, 0.1, 0.3], **where[0]}],
                        "cylinders": [{"name": "tank", "radius_m": 0.1, "length_m": 0.3, **where[1]}],
                    }
                ),
            )
        )

    one, other = np.asarray(joints), np.asarray(joints) + turn * np.eye(6)[0]
    before, after = cell(Pose.identity()).distances_m(one), cell(around).distances_m(other)
    assert before.keys() == after.keys()
    for pair, distance in before.items():
        assert after[pair] == pytest.approx(distance, abs=2e-5), pair


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_the_quick_answer_is_the_least_of_all(seed: int) -> None:
    joints = HOME + np.random.default_rng(seed).uniform(-1.2, 1.2, 6)
    model = cell_with(
        keep_out=[{"name": "aside", "size_m": [0.3, 0.3, 0.3], "position_m": [0.2, 0.5, 0.3]}],
        cylinders=[{"name": "post", "radius_m": 0.03, "length_m": 1.0, "position_m": [0.4, 0.1, 0.5]}],
    )
    found, every = model.clearance(joints), model.distances_m(joints)
    assert found.distance_m == pytest.approx(min(every.values()), abs=1e-6)
    assert every[found.moving, found.obstacle] == pytest.approx(found.distance_m, abs=1e-6)


@settings(max_examples=100, deadline=None)
@given(offset=st.tuples(*[st.floats(-1.0, 1.0)] * 6), size=st.floats(0.1, 4.0))
def test_the_fixture_covers_the_plate_wherever_the_prior_lets_it_be(offset: tuple[float, ...], size: float) -> None:
    prior = HolePrior(half_range_lateral_m=0.01 * size, half_range_rotation_rad=0.1 * size)
    workcell = Workcell(hole_prior=prior)
    fixture = Fixture.of(workcell)
    lower, upper = plate_corners_m(workcell.hole.shape(workcell.peg.shape()))
    corners = np.array(np.meshgrid(*zip(lower, upper, strict=True))).reshape(3, -1).T
    off = np.asarray(offset) * prior.half_ranges()
    moved = Pose.from_rotvec(off[3:], off[:3]).apply(corners)
    assert np.all(moved >= fixture.lower_m - 1e-12) and np.all(moved <= fixture.upper_m + 1e-12)


def test_a_floor_is_level_also_under_a_tilted_base() -> None:
    tilt = Rotation.from_rotvec([0.3, 0.0, 0.0])
    gravity = tuple((-9.81 * tilt.apply([0.0, 0.0, 1.0])).tolist())
    model = CollisionModel(Workcell(gravity_base_m_s2=gravity, surroundings=Surroundings(floor_height_m=-0.1)))
    wrist = placed(PARTS["arm link 5"], HOME).translation_m
    height = float(tilt.apply([0.0, 0.0, 1.0]) @ wrist) + 0.1
    found = model.distances_m(HOME)["arm link 5", "the floor"]
    assert found == pytest.approx(height - PARTS["arm link 5"].radius_m, abs=1e-9)
