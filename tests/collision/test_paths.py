"""What of a path is refused: by its part and obstacle, with the exception for the peg at work and for none else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.arm.inverse import nearest
from crosspih_common.collision import CollisionModel, Violation
from crosspih_common.config import HolePrior, Surroundings, Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

CELL = Workcell()
HOME = np.asarray(CELL.home_joints_rad)
MODEL = CollisionModel(CELL)
HOLE = CELL.hole_prior.pose_base_hole()
TIP_M = CELL.peg.shape().tip_m


def before(distance_m: float, aside_m: float = 0.0, tilt_rad: float = 0.0, workcell: Workcell = CELL) -> Pose:
    """`pose_base_peg`: the tip that far before the nominal face."""
    hole = workcell.hole_prior.pose_base_hole()
    at_tip = hole @ Pose.from_rotvec([0.0, tilt_rad, 0.0], [aside_m, 0.0, -distance_m])
    return at_tip @ Pose.from_translation([0.0, 0.0, -TIP_M])


def joints_at(pose_base_peg: Pose) -> Array:
    return nearest(CELL.arm(), pose_base_peg @ CELL.pose_flange_peg().inverse(), HOME)


def line(start: Pose, goal: Pose) -> Array:
    shares = np.linspace(0.0, 1.0, 12)
    way = goal.translation_m - start.translation_m
    return np.array([joints_at(Pose(start.rotation, start.translation_m + share * way)) for share in shares])


def with_box(**box: object) -> CollisionModel:
    return CollisionModel(Workcell(surroundings=Surroundings.model_validate({"boxes": [{"name": "post", **box}]})))


def test_the_straight_way_into_the_hole_is_open_to_a_working_move_only() -> None:
    way = line(before(0.06), before(-0.035))
    assert MODEL.check_path(way, working=True) is None
    refused = MODEL.check_path(way)
    assert refused is not None and (refused.moving, refused.obstacle) == ("the peg", "the fixture")
    assert "the peg would come within" in str(refused) and "(want 15 mm)" in str(refused)
    assert MODEL.clearance(way[-1]).distance_m < 0.0 < MODEL.clearance(way[-1], working=True).distance_m


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        (before(0.12, aside_m=0.075), before(0.0, aside_m=0.075)),  # onto the plate, where no hole can be
        (before(0.12, tilt_rad=-0.6), before(0.0, tilt_rad=-0.6)),  # at the hole, but across
    ],
    ids=["aside", "askew"],
)
def test_the_peg_is_at_work_only_where_a_hole_can_be(start: Pose, goal: Pose) -> None:
    refused = MODEL.check_path(line(start, goal), working=True)
    assert refused is not None and refused.obstacle == "the fixture"


def test_a_post_in_the_way_is_named_and_a_path_beside_it_goes() -> None:
    goal = joints_at(before(0.06))
    middle = CELL.pose_base_peg((HOME + goal) / 2).apply([0.0, 0.0, 0.05])
    assert MODEL.check_path([HOME, goal]) is None
    refused = with_box(size_m=[0.02, 0.02, 0.02], position_m=middle.tolist()).check_path([HOME, goal])
    assert isinstance(refused, Violation)
    assert refused.obstacle == "post" and refused.moving in ("the peg", "the tool") and refused.index == 1
    assert refused.distance_m < refused.wanted_m == MODEL.margin_m
    aside = (middle + np.array([0.0, 0.4, 0.0])).tolist()
    assert with_box(size_m=[0.02, 0.02, 0.02], position_m=aside).check_path([HOME, goal]) is None


def test_a_keep_out_box_before_the_hole_stops_also_a_working_move() -> None:
    place = {"position_m": HOLE.apply([0.0, 0.0, -0.02]).tolist(), "size_m": [0.01, 0.01, 0.01]}
    kept = Surroundings.model_validate({"keep_out": [{"name": "a gauge", **place}]})
    refused = CollisionModel(Workcell(surroundings=kept)).check_path(line(before(0.08), before(0.0)), working=True)
    assert refused is not None and refused.obstacle == "a gauge"


def test_the_floor_is_named() -> None:
    low = HOME.copy()
    low[1] += 0.7
    refused = MODEL.check_path([HOME, low])
    assert refused is not None and refused.obstacle == "the floor"


def test_an_arm_that_stands_too_near_may_leave_but_come_no_nearer() -> None:
    tip = CELL.pose_base_peg(HOME)
    side = tip.rotation[:, 0]
    centre = tip.apply([0.0, 0.0, 0.05]) + side * (0.03 + 0.02 + MODEL.margin_m / 3)
    near = with_box(size_m=[0.04, 0.04, 0.04], position_m=centre.tolist(), rotvec_rad=tip.rotvec_rad().tolist())
    assert near.clearance(HOME).distance_m < near.margin_m
    away, nearer = (joints_at(Pose(tip.rotation, tip.translation_m + share * side)) for share in (-0.05, 0.01))
    assert near.check_path([HOME, away]) is None
    refused = near.check_path([HOME, nearer])
    assert refused is not None and refused.obstacle == "post"


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_nothing_is_met_between_the_postures_that_are_looked_at(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = np.array([HOME, HOME + rng.uniform(-1.0, 1.0, 6)])
    if MODEL.check_path(path) is None:
        finer = [path[0] + share * (path[1] - path[0]) for share in rng.uniform(0.0, 1.0, 100)]
        assert min(MODEL.clearance(joints).distance_m for joints in finer) >= 0.5 * MODEL.margin_m


@settings(max_examples=30, deadline=None)
@given(
    distance=st.floats(-0.04, 0.1), aside=st.floats(-0.03, 0.03), tilt=st.floats(-0.2, 0.2), depth=st.floats(0.01, 0.06)
)
def test_back_before_the_zone_the_peg_is_clear_by_the_margin(
    distance: float, aside: float, tilt: float, depth: float
) -> None:
    workcell = Workcell(hole_prior=HolePrior(half_range_depth_m=depth), surroundings=Surroundings(stand_radius_m=None))
    model = CollisionModel(workcell)
    pose = before(distance, aside, tilt)
    back = model.before_zone(pose)
    assert model.tip_clearance_m(back) >= model.margin_m
    assert model.before_zone(back).distance_to_m(back) < 1e-9
    moved = pose.inverse().apply(back.translation_m)
    assert np.allclose(moved[:2], 0.0, atol=1e-12) and moved[2] <= 1e-12


def test_a_peg_straight_before_the_zone_is_as_far_as_it_is() -> None:
    front = -float(MODEL.fixture.lower_m[2])
    assert MODEL.tip_clearance_m(before(front + 0.05)) == pytest.approx(0.05, abs=1e-6)
    assert MODEL.tip_clearance_m(before(front - 0.01)) == pytest.approx(-0.01, abs=1e-6)


def test_a_path_of_another_arm_is_refused() -> None:
    with pytest.raises(ValueError, match=r"wants shape \(k, 6\)"):
        MODEL.check_path(np.zeros((2, 7)))
