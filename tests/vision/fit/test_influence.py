"""How far the pose goes without each edge: as by solving anew, and larger where something lies along an edge."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from services.vision.covariance import covariance_of
from services.vision.fit.climb import climb, rims
from services.vision.fit.influence import jackknife, without_each
from services.vision.fit.quality import quality_of
from services.vision.fit.solve import POSE, TWICE, Doubts, Fit, Images, parameters
from tests.vision.detect.test_detect import HALF_RANGES, STEREO, truth_of
from tests.vision.fit.test_hard_pictures import CHI2_6_9999, HOLE
from tests.vision.pictures.drawn_pairs import Look, drawn_pair

COARSE, FINE = rims(HOLE)
TRUTH = truth_of(STEREO, 3)
PICTURES = drawn_pair(STEREO, HOLE, TRUTH, Look(seed=3))


def fitted(images: Images) -> Fit:
    fit, _ = climb(images, COARSE, FINE, STEREO, [TRUTH], Doubts())
    assert fit is not None
    return fit


def with_a_cable(images: Images, edge: int) -> Images:
    """A dark strip 4 px wide along one edge in the left picture alone, across it from one end to the other."""
    ends = STEREO.project(TRUTH.apply(FINE.outer_m[edge, [0, -1]]))[0]
    along = ends[1] - ends[0]
    aside = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    inward = aside * np.sign(aside @ (STEREO.project(TRUTH.apply(np.zeros(3)))[0] - ends.mean(axis=0)))
    line = np.array([ends[0] - 0.3 * along - inward, ends[1] + 0.3 * along + inward])
    left = images[0].copy()
    start, end = (tuple(int(value) for value in np.rint(16 * point)) for point in line)
    cv2.line(left, start, end, 20.0, 4, cv2.LINE_AA, 4)
    return left, images[1]


def test_it_is_as_solved_anew_without_the_edge() -> None:
    fit = fitted(PICTURES)
    moved, index = without_each(fit, FINE), parameters(FINE)[0]
    information = np.linalg.inv(fit.covariance)
    for side, edge in ((0, 0), (1, 5)):
        less, pull = information.copy(), information @ fit.effects
        which = index[side, edge]
        less[np.ix_(which, which)] -= fit.local[side, edge][np.ix_(TWICE, TWICE)]
        pull[which] -= fit.gradient[side, edge][TWICE]
        anew = np.linalg.solve(less, pull) - fit.effects
        assert moved[side, edge] == pytest.approx(anew[:POSE], rel=1e-4, abs=1e-9)


def test_a_cable_along_an_edge_makes_the_pose_less_sure() -> None:
    clean, cabled = fitted(PICTURES), fitted(with_a_cable(PICTURES, 3))
    sds = [np.sqrt(np.diag(jackknife(fit, FINE))) for fit in (clean, cabled)]
    assert np.max(sds[1] / sds[0]) > 2.0
    off = cabled.state.pose_camera_hole.inverse() @ TRUTH
    error = np.concatenate([off.translation_m, off.rotvec_rad()])
    covariance = covariance_of(cabled, FINE, quality_of(cabled, FINE, Doubts()), HALF_RANGES, np.zeros((6, 6)))
    assert error @ np.linalg.solve(covariance, error) < CHI2_6_9999
