"""Presses against the bore's walls, made by the engine with friction: the pose to hundredths, and honest about it."""

import dataclasses

import numpy as np
import pytest

from crosspih_common.geometry import Pose
from crosspih_common.shapes import CrossPeg
from services.inference.estimator import HolePosePrior, TouchObservation, pressed_estimate
from tests.inference.free_peg_world import FreePegWorld

PEG = CrossPeg()
HOLE = PEG.hole(1e-4)
TRUTH = Pose.from_rotvec([0.4, -1.1, 0.3], [0.4, -0.3, 0.2])
SEAT_SD = (4e-5, 4e-5, 1e-3, 3e-3, 3e-3, 2e-3)
READING_SD = np.repeat([0.02, 0.001], 3)
DEPTH_M = PEG.taper_start_m - HOLE.chamfer_m - 0.02


def presses(world: FreePegWorld, rng: np.random.Generator) -> list[TouchObservation]:
    """Four presses of a somewhat crooked peg, each creeping on for 0.1 mm after it touches."""
    rest = Pose.from_rotvec(rng.normal(size=3) * 5e-4, [*rng.normal(size=2) * 2e-5, -DEPTH_M])
    made = []
    for direction in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]):
        world.place(rest)
        commands, wrenches = [], []
        for step in range(300):
            command = Pose(rest.rotation, rest.translation_m + 1e-6 * step * np.array(direction))
            world.step(command, np.array([*(1e-3 * np.array(direction)), 0.0, 0.0, 0.0]))
            commands.append(command)
            wrenches.append(world.contact_wrench_peg())
        middle = commands[-13]
        wrench = np.mean(wrenches[-25:], axis=0) + rng.normal(size=6) * READING_SD
        made.append(TouchObservation(TRUTH @ middle, wrench, READING_SD, world.compliance_peg, TRUTH.rotate(direction)))
    return made


def seat(rng: np.random.Generator) -> HolePosePrior:
    error = rng.normal(size=6) * SEAT_SD
    return HolePosePrior.from_sd(TRUTH @ Pose.from_rotvec(error[3:], error[:3]), SEAT_SD)


@pytest.fixture(scope="module")
def world() -> FreePegWorld:
    return FreePegWorld(PEG, HOLE, 0.1)


def test_four_presses_give_the_pose_to_hundredths(world: FreePegWorld) -> None:
    squares = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        prior = seat(rng)
        found = pressed_estimate(PEG, HOLE, prior, presses(world, rng))
        left = found.pose_base_hole.inverse() @ TRUTH
        assert all(found.used)
        assert np.linalg.norm(left.translation_m[:2]) < 1.5e-5
        assert np.degrees(np.linalg.norm(left.rotvec_rad())) < 0.1
        error = np.concatenate([left.translation_m, left.rotvec_rad()])
        squares.append(float(error @ np.linalg.solve(found.covariance, error)))
    assert np.median(squares) < 13.0  # 6 degrees of freedom, 95 %


def test_a_press_that_does_not_fit_is_left_out(world: FreePegWorld) -> None:
    rng = np.random.default_rng(9)
    prior, made = seat(rng), presses(world, rng)
    made[2] = dataclasses.replace(made[2], wrench_peg=made[2].wrench_peg + np.array([0, 0, 0, 0, 0, 2.0]))
    found = pressed_estimate(PEG, HOLE, prior, made)
    assert found.used == (True, True, False, True)
    assert np.linalg.norm((found.pose_base_hole.inverse() @ TRUTH).translation_m[:2]) < 3e-5


def test_it_says_what_it_wants() -> None:
    with pytest.raises(ValueError, match="at least one press"):
        pressed_estimate(PEG, HOLE, HolePosePrior.from_sd(TRUTH, SEAT_SD), [])
    outside = TRUTH @ Pose.from_translation([0.0, 0.0, -PEG.tip_m])
    touch = TouchObservation(outside, np.ones(6), READING_SD, np.zeros((6, 6)), np.array([1.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match="short of the bore"):
        pressed_estimate(PEG, HOLE, HolePosePrior.from_sd(TRUTH, SEAT_SD), [touch])
