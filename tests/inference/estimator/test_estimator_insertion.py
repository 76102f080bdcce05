"""A peg stuck in its bore: what holds it, by known answers and by what the engine does next."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import BoreContact, InsertionAction
from crosspih_common.shapes import CrossPeg, Outline, Peg
from services.inference.estimator import BoreWalls, InsertionJudgement, advise_insertion
from services.inference.estimator.insertion import bore_load, clamps
from tests.inference.free_peg_world import FreePegWorld

PEG = CrossPeg()
HOLE = PEG.hole(1e-4)
WALLS = BoreWalls.of(PEG, HOLE)
COVARIANCE = np.diag([1e-8, 1e-8, 1e-6, 1e-5, 1e-5, 1e-5])
STIFF = np.diag([1e-5] * 3 + [1e-3] * 3)
PUSH_N = 12.0


def inside(depth_m: float) -> Pose:
    """The centred peg with its body that deep in the bore, hole frame."""
    return Pose.from_translation([0.0, 0.0, HOLE.chamfer_m + depth_m - PEG.taper_start_m])


def advised(pose: Pose, wrench: Array, friction: float = 0.3) -> InsertionJudgement:
    return advise_insertion(PEG, HOLE, Pose.identity(), COVARIANCE, pose, wrench, STIFF, friction, PUSH_N)


def test_walls_of_the_cross_are_twelve_with_two_places_each() -> None:
    assert WALLS.places_m.shape == (24, 2) and WALLS.turn_fixed
    assert WALLS.clearances_m == pytest.approx(1e-4, abs=1e-9)
    assert np.linalg.norm(WALLS.normals, axis=1) == pytest.approx(1.0)
    assert np.abs(WALLS.normals.sum(axis=0)).max() < 1e-9


def test_a_round_peg_is_not_held_in_its_turn() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    outline = Outline.of("round", 0.02 * np.column_stack([np.cos(angle), np.sin(angle)]), 0)
    peg = Peg(outline, 0.012, 0.0537, 0.0897, 0.0797)
    walls = BoreWalls.of(peg, peg.hole(1e-4))
    assert not walls.turn_fixed
    assert np.linalg.matrix_rank(walls.points(0.01), tol=1e-6) == 2
    both = np.concatenate([walls.points(0.001), walls.points(0.02)])
    assert np.linalg.matrix_rank(both, tol=1e-6) == 4


def test_wedging_begins_where_whitney_says() -> None:
    """Opposite ends of the cross, 54 mm apart, see each other in their cones until the depth is mu times that."""
    assert clamps(WALLS, 0.3 * 0.054 - 1e-5, 0.3)
    assert not clamps(WALLS, 0.3 * 0.054 + 1e-5, 0.3)
    assert not clamps(WALLS, 0.001, 0.0)


def test_a_lateral_load_needs_its_friction() -> None:
    load = bore_load(WALLS, 0.001, 0.009, np.array([10.0, 0.0, 0.0, 0.0, 0.05, 0.0]), 0.0)
    assert load.needed_force_n == 0.0
    # 10 N at the middle of both heights: half at the rim, half at the leading end
    assert load.forces_n.sum(axis=1) == pytest.approx([5.0, 5.0], abs=0.05)


def test_free_and_outside() -> None:
    free = advised(inside(0.006), np.zeros(6))
    assert (free.contact, free.action) == (BoreContact.FREE, InsertionAction.CONTINUE)
    assert free.entered_m == pytest.approx(0.006)
    outside = advised(inside(-0.004), np.array([0.0, 0.0, -5.0, 0.0, 0.0, 0.0]))
    assert (outside.contact, outside.action) == (BoreContact.OUTSIDE, InsertionAction.BACK_OFF)
    assert outside.back_off_m > PEG.taper_length_m


def test_what_no_felt_wall_can_hold_is_a_wedge() -> None:
    """12 N against the push, and no wall felt: two walls clamp one another, and the peg must come out of the bore."""
    held = advised(inside(0.005), np.array([0.0, 0.0, -PUSH_N, 0.0, 0.0, 0.0]))
    assert (held.contact, held.action) == (BoreContact.WEDGED, InsertionAction.BACK_OFF)
    assert held.back_off_m > 0.005 and held.push_force_n < PUSH_N
    end = held.pose_base_peg.apply([0.0, 0.0, PEG.taper_start_m])
    assert end[2] < HOLE.chamfer_m
    assert held.pose_base_peg.rotation[:, 2] == pytest.approx(held.pose_base_hole.rotation[:, 2])


def askew(seed: int) -> tuple[float, Array, Array]:
    """A peg 3-10 mm inside (m), its wrist turned by up to 0.5 degrees (rotation vector, rad) and aside by up to 0.2 mm
    (m)."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.003, 0.010)
    axis = rng.normal(size=3)
    turn = np.radians(rng.uniform(0.1, 0.5)) * axis / np.linalg.norm(axis)
    return depth, turn, rng.uniform(-2e-4, 2e-4, 2)


def pushed(
    world: FreePegWorld, depth: float, turn: Array, aside: Array, push_n: float = PUSH_N
) -> tuple[Pose, Array, bool]:
    """A peg so deep inside, its wrist turned and moved aside, then pushed: command, wrench, whether it stood."""
    middle = Pose.from_translation([0.0, 0.0, HOLE.chamfer_m + 0.5 * depth])
    world.place(inside(depth))
    for share in np.minimum(np.arange(300) / 200, 1.0):
        command = middle @ Pose.from_rotvec(share * turn, [*(share * aside), 0.0]) @ middle.inverse() @ inside(depth)
        world.step(command)
    before = world.pose_hole_peg().translation_m[2]
    felt: list[Array] = []
    for _ in range(8000):
        command = Pose(command.rotation, command.translation_m + np.array([0.0, 0.0, 1e-6]))
        world.step(command, np.array([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0]))
        felt.append(world.contact_wrench_peg())
        if world.pose_hole_peg().translation_m[2] - before > 0.001:
            return command, np.mean(felt[-25:], axis=0), False
        if len(felt) > 30 and -np.mean([wrench[2] for wrench in felt[-20:]]) > push_n:
            break
    return command, np.mean(felt[-25:], axis=0), True


def test_the_engine_slides_and_jams_where_the_load_says() -> None:
    world = FreePegWorld(PEG, HOLE, 0.3)
    jams = 0
    for seed in (0, 1, 2, 14, 18, 19):
        command, wrench, stood = pushed(world, *askew(seed))
        advice = advised(command, wrench)
        if stood:
            jams += 1
            assert advice.contact is BoreContact.JAMMED
            assert advice.action is InsertionAction.BACK_OFF
            assert advice.needed_force_n > PUSH_N
        else:
            assert advice.action is InsertionAction.CONTINUE
            # a sliding peg is held by exactly its friction
            assert advice.needed_force_n == pytest.approx(-wrench[2], abs=0.5)
    world.close()
    assert 0 < jams < 6


def test_going_where_the_advice_says_frees_the_peg() -> None:
    """Jammed, the peg taken to the advised pose and pushed again along the bore goes in."""
    world = FreePegWorld(PEG, HOLE, 0.3)
    command, wrench, stood = pushed(world, *askew(18))
    assert stood
    advice = advised(command, wrench)
    assert advice.action is InsertionAction.BACK_OFF
    aim = advice.pose_base_peg
    world.place(aim)
    start = aim.translation_m[2]
    for step in range(4000):
        at = Pose(aim.rotation, aim.translation_m + 2e-6 * step * aim.rotation[:, 2])
        world.step(at, np.concatenate([2e-3 * aim.rotation[:, 2], np.zeros(3)]))
        if -world.contact_wrench_peg()[2] > PUSH_N:
            break
    assert world.pose_hole_peg().translation_m[2] - start > 0.006
    world.close()


@pytest.mark.parametrize(("friction", "contact"), [(0.1, BoreContact.JAMMED), (0.5, BoreContact.WEDGED)])
def test_the_engine_wedges_where_whitney_says(friction: float, contact: BoreContact) -> None:
    """7.5 mm inside and turned beyond its two contacts, the peg's ends, 54 mm apart, see each other in cones of 0.5 but
    not of 0.1 (5.4 mm). Neither gives way to four times the push. tests/planning/test_stuck.py has how it ends."""
    world = FreePegWorld(PEG, HOLE, friction)
    depth = 0.0075
    for turn in (np.array([1.2, 0.0, 0.0]), np.array([0.0, -1.5, 0.0])):
        turn = turn * 2e-4 / depth
        _, _, held = pushed(world, depth, turn, np.zeros(2), 4.0 * PUSH_N)
        assert held
        command, wrench, stood = pushed(world, depth, turn, np.zeros(2))
        assert stood
        advice = advised(command, wrench, friction)
        assert (advice.contact, advice.action) == (contact, InsertionAction.BACK_OFF)
        # out of a wedge means out of the bore, and then not so hard
        assert (advice.back_off_m > depth) == (contact is BoreContact.WEDGED)
        assert (advice.push_force_n < PUSH_N) == (contact is BoreContact.WEDGED)
    world.close()
