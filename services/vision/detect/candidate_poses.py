"""Candidate poses of the rim in both pictures, as starts for the fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.detect.coarse_search import SearchGrid, best_starts
from services.vision.detect.edge_fit import Poses, likeness, refined, support
from services.vision.detect.picture_level import Floats, Level
from services.vision.detect.rim_samples import RimSamples
from services.vision.fit.rim import Rimmed
from services.vision.stereo import StereoModel

SEARCH_SAMPLES, SAMPLES = 64, 96
SKIP_CORNER_PX = 1.5
PRIOR_SLACK = 1.3
STARTS, KEPT, MAX_ = 8, 4, 5
# search reach along the rim's normals, px of the level, one value per iteration: first edges, then the two steps of a
# chamfer
FIRST_PX, EDGES_PX, STEPS_PX = (5.0, 4.0, 3.0), (2.5, 2.0, 2.0), (3.0, 2.5, 2.0, 2.0)
# least distance of two rims, px: to refine both, and to count as two answers
WORTH_PX, SAME_PX = 1.5, 0.7
MIN_UNEXPLAINED = 0.001


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A pose at which the rim may be, and its score.

    `score` 0 to 1: how much of the rim looks like it, the mean over both pictures.
    """

    pose_camera_hole: Pose
    score: float


def candidates(
    images: Sequence[Floats], stereo: StereoModel, hole: Rimmed, nominal: Pose, half_ranges: Array
) -> list[Candidate]:
    """Where the hole may be: always one to five poses; the score says how well each is supported.

    Sorted by how little of the picture near the rim they leave unexplained. The first is mostly within a pixel, one of
    them nearly always. A fit from each decides.

    `images` left and right, (height, width) each, grey 0 to 255, linear in light; `nominal` is `pose_base_hole` by the
    cell's drawing, `half_ranges` (6,) how far it may be off, m and rad.
    """
    prior = stereo.pose_base_camera.inverse() @ nominal
    ranges = PRIOR_SLACK * np.asarray(half_ranges, float)
    skip_m = SKIP_CORNER_PX * _pixel_m(stereo, prior)
    grid = SearchGrid.of(RimSamples.of(hole, SEARCH_SAMPLES, skip_m), stereo, prior, ranges)
    samples = RimSamples.of(hole, SAMPLES, skip_m)
    windows = grid.windows()

    def at(factors: Sequence[int]) -> tuple[Level, Level]:
        left, right = (Level.of(images[side], windows[side], factors[side]) for side in range(2))
        return left, right

    factors: tuple[int, ...] = grid.factors
    poses = Poses.of(best_starts(at(grid.factors), grid, STARTS))
    first = True
    while first or max(factors) > 1:
        factors = tuple((factor + 1) // 2 for factor in factors)
        levels = at(factors)
        if first:
            poses = refined(levels, samples, stereo, poses, prior, ranges, FIRST_PX)
            score = support(levels, samples, stereo, poses).mean(axis=(0, 2))
            poses = poses.taken(_apart(samples, stereo, poses, score, WORTH_PX * min(factors))[:KEPT])
            poses = refined(levels, samples, stereo, poses, prior, ranges, EDGES_PX)
            score = _rank(np.asarray(likeness(levels, samples, stereo, poses), dtype=float))
            poses = poses.taken(_apart(samples, stereo, poses, score, SAME_PX * min(factors)))
            poses = _with_slips(poses, samples)
        poses = refined(levels, samples, stereo, poses, prior, ranges, STEPS_PX, by_steps=True)
        first = False
    seen = np.asarray(likeness(levels, samples, stereo, poses), dtype=float)
    score = seen.mean(axis=(0, 2))
    chosen = _apart(samples, stereo, poses, _rank(seen), SAME_PX)[:MAX_]
    return [Candidate(poses[index], float(score[index])) for index in chosen]


def _with_slips(poses: Poses, samples: RimSamples) -> Poses:
    """The poses, and copies of the first one shifted by a chamfer's width in four directions: if one line of a chamfer
    is bright on one side and dark on the other, it is easily mistaken for the other line."""
    width = float(np.abs(samples.inner_m - samples.outer_m)[:, 2].max())
    steps = np.zeros((4, 6))
    steps[:, :2] = width * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    slipped = poses.taken([0] * 4).moved(steps)
    return Poses(
        np.concatenate([poses.rotation, slipped.rotation]), np.concatenate([poses.translation_m, slipped.translation_m])
    )


def _rank(seen: Array) -> Array:
    """(K,): the mean logarithm of the unexplained share of each profile (2, K, M), as in a likelihood."""
    return np.asarray(-np.log(1.0 + MIN_UNEXPLAINED - seen).mean(axis=(0, 2)))


def _apart(samples: RimSamples, stereo: StereoModel, poses: Poses, score: Array, least_px: float) -> list[int]:
    """Indices of poses, best first, without those whose rim lies within `least_px` of a better one's everywhere."""
    where = stereo.project(poses.apply(samples.at(0.5)))
    result: list[int] = []
    for index in np.argsort(score)[::-1]:
        if all(np.abs(where[:, index] - where[:, other]).max() > least_px for other in result):
            result.append(int(index))
    return result


def _pixel_m(stereo: StereoModel, pose_camera_hole: Pose) -> float:
    """The size of one pixel of the coarser picture at the hole, m."""
    seen = stereo.project(pose_camera_hole.apply(np.array([[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0]])))
    return float(1e-3 / np.linalg.norm(seen[:, 1] - seen[:, 0], axis=-1).min())
