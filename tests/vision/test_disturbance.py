"""A worse camera: the same pictures give the same error, others another, and the covariance says how large it is."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array
from services.vision.config import ExtraNoise
from services.vision.disturbance import disturbed
from services.vision.locate import Located

POSE = Workcell().hole_prior.pose_base_hole()
NOISE = ExtraNoise(lateral_m=0.001, depth_m=0.002, rotation_rad=0.05)
BLANK = np.zeros((4, 4), dtype=np.uint8)
FOUND = Located(POSE, np.diag(np.full(6, 1e-8)), {}, BLANK, BLANK)


def errors(noise: ExtraNoise, orientation_measured: bool, count: int) -> Array:
    rng = np.random.default_rng(0)
    rows = []
    for _ in range(count):
        picture = rng.integers(0, 255, (8, 8)).astype(np.uint8)
        pose = disturbed(FOUND, noise, picture, BLANK, orientation_measured).pose_base_hole
        off = POSE.inverse() @ pose
        rows.append(np.concatenate([off.translation_m, off.rotvec_rad()]))
    return np.array(rows)


def test_no_noise_changes_nothing() -> None:
    assert disturbed(FOUND, ExtraNoise(), BLANK, BLANK, True) is FOUND


def test_the_same_pictures_give_the_same_answer() -> None:
    one, two = (disturbed(FOUND, NOISE, BLANK, BLANK, True).pose_base_hole.matrix() for _ in range(2))
    assert np.array_equal(one, two)
    other = disturbed(FOUND, NOISE, BLANK + np.uint8(1), BLANK, True).pose_base_hole.matrix()
    assert not np.allclose(one, other)


def test_the_error_is_as_large_as_it_says() -> None:
    spread = errors(NOISE, True, 2000).std(axis=0)
    assert spread == pytest.approx([0.001, 0.001, 0.002, 0.05, 0.05, 0.05], rel=0.06)
    covariance = disturbed(FOUND, NOISE, BLANK, BLANK, True).covariance
    assert np.sqrt(np.diag(covariance)) == pytest.approx([0.001, 0.001, 0.002, 0.05, 0.05, 0.05], rel=0.01)


def test_an_assumed_orientation_is_left_alone() -> None:
    assert np.abs(errors(NOISE, False, 20)[:, 3:]).max() < 1e-9
