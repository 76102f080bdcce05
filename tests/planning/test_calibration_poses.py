"""Calibration poses: inside limits, clear of the fixture and floor all the way, and well spread."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from crosspih_common.arm import xb4
from crosspih_common.arm.inverse import nearest
from crosspih_common.collision import CollisionModel
from crosspih_common.config import HolePrior, Surroundings, Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.planning.calibration_poses import CalibrationPosesError, choose_calibration_poses

ARM = xb4()
CELL = Workcell()
COLLISIONS = CollisionModel(CELL)
HOLE = Pose.from_matrix(
    [[-0.07, 0.06, 1.0, 0.4], [-0.06, -1.0, 0.06, -0.3], [1.0, -0.06, 0.07, 0.2], [0.0, 0.0, 0.0, 1.0]]
)
TIP = Pose.from_translation([0.0, 0.0, 0.146])
SEED = (-0.9419, 1.0352, 0.3222, -0.9528, -1.4459, 0.1735)


def before_the_hole(gap_m: float) -> Array:
    return nearest(ARM, HOLE @ Pose.from_translation([0.0, 0.0, -gap_m]) @ TIP.inverse(), SEED)


@pytest.mark.parametrize(
    "start",
    [np.zeros(6), np.array([-0.7, 0.2, 0.2, 0.0, 1.0, 0.0]), before_the_hole(0.1)],
    ids=["zero", "side", "near"],
)
def test_six_poses_spread_gravity_and_stay_clear_all_the_way(start: Array) -> None:
    poses = choose_calibration_poses(ARM, start, COLLISIONS)
    assert len(poses) == 6
    directions = []
    for joints in poses:
        assert ARM.limits.violations(joints) == []
        directions.append(ARM.pose_base_flange(joints).rotation.T @ np.array([0.0, 0.0, -1.0]))
    # Every sensor axis is pulled at from both sides, and no direction is farther than 75 degrees from a pose's.
    assert np.all(np.max(directions, axis=0) > 0.3)
    assert np.all(np.min(directions, axis=0) < -0.3)
    around = np.random.default_rng(0).normal(size=(2000, 3))
    around /= np.linalg.norm(around, axis=1)[:, None]
    assert np.min(np.max(around @ np.array(directions).T, axis=1)) > np.cos(np.deg2rad(75.0))
    force_design = np.vstack([np.hstack([ARM.pose_base_flange(q).rotation.T, np.eye(3)]) for q in poses])
    assert np.linalg.cond(force_design) < 2.0
    zone = COLLISIONS.fixture
    for a, b in pairwise([start, *poses]):
        for share in np.linspace(0.0, 1.0, 60):
            joints = a + share * (b - a)
            assert COLLISIONS.clearance(joints).distance_m > 0.5 * COLLISIONS.margin_m
            tip = ARM.pose_base_flange(joints).apply([0.0, 0.0, 0.146])
            in_hole = zone.pose_base_hole.inverse().apply(tip)
            assert np.any(in_hole < zone.lower_m - 0.007) or np.any(in_hole > zone.upper_m + 0.007)
            assert tip[2] > 0.007


def test_the_same_start_gives_the_same_poses() -> None:
    first = choose_calibration_poses(ARM, np.zeros(6), COLLISIONS)
    assert [pose.tolist() for pose in choose_calibration_poses(ARM, np.zeros(6), COLLISIONS)] == [
        pose.tolist() for pose in first
    ]


def test_refusals_say_what_is_in_the_way() -> None:
    with pytest.raises(CalibrationPosesError, match="between the peg and the fixture"):
        choose_calibration_poses(ARM, before_the_hole(0.0), COLLISIONS)
    with pytest.raises(CalibrationPosesError, match="joint 5"):
        choose_calibration_poses(ARM, [0.0, 0.0, 0.0, 0.0, 3.0, 0.0], COLLISIONS)
    with pytest.raises(CalibrationPosesError, match="at least 6"):
        choose_calibration_poses(ARM, np.zeros(6), COLLISIONS, count=4)
    with pytest.raises(CalibrationPosesError, match="of 6 poses can be reached"):
        choose_calibration_poses(ARM, np.zeros(6), COLLISIONS, candidates=5)


def test_more_poses_on_request() -> None:
    poses = choose_calibration_poses(ARM, np.zeros(6), COLLISIONS, count=9)
    assert len({tuple(pose.tolist()) for pose in poses}) == 9


@pytest.mark.parametrize("by_m", [(0.1, 0, 0), (-0.1, 0, 0), (0, 0.1, 0), (0, -0.1, 0), (0, 0, 0.1), (0, 0, -0.1)])
def test_a_fixture_that_is_moved_is_kept_clear_of_where_it_is(by_m: tuple[float, float, float]) -> None:
    moved = np.array(CELL.hole_prior.matrix_base_hole)
    moved[:, 3] += by_m
    prior = HolePrior(matrix_base_hole=tuple(map(tuple, moved.tolist())))
    poses = choose_calibration_poses(ARM, CELL.home_joints_rad, CollisionModel(Workcell(hole_prior=prior)))
    # the plate at its nominal pose, declared as a box of its own, without what the prior adds
    middle = prior.pose_base_hole() @ Pose.from_translation([0.0, 0.0, 0.025])
    placed = {"position_m": middle.translation_m.tolist(), "rotvec_rad": middle.rotvec_rad().tolist()}
    plate = {"name": "the plate", "size_m": [0.12, 0.12, 0.05], **placed}
    witness = CollisionModel(Workcell(surroundings=Surroundings.model_validate({"boxes": [plate]})))
    for a, b in pairwise([np.array(CELL.home_joints_rad), *poses]):
        for share in np.linspace(0.0, 1.0, 40):
            gaps = witness.distances_m(a + share * (b - a))
            assert min(gap for (_, obstacle), gap in gaps.items() if obstacle == "the plate") > COLLISIONS.margin_m


def test_the_poses_of_the_default_cell_are_those_its_results_were_made_with() -> None:
    poses = choose_calibration_poses(ARM, CELL.home_joints_rad, COLLISIONS)
    assert [round(float(pose[0]), 3) for pose in poses] == [-0.908, -1.407, -1.445, -1.299, -1.918, -1.967]


def test_what_is_in_the_way_of_the_poses_is_named() -> None:
    high = CollisionModel(Workcell(surroundings=Surroundings(floor_height_m=0.18)))
    with pytest.raises(CalibrationPosesError, match=r"of 6 poses can be reached.*start farther from the floor"):
        choose_calibration_poses(ARM, CELL.home_joints_rad, high, candidates=12)
