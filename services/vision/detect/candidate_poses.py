"""Poses at which both pictures show the rim, for a fit to start from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.detect.coarse_search import SearchGrid, best_starts
from services.vision.detect.picture_level import Floats, Level
from services.vision.detect.refinement import Poses, likeness, refined, support
from services.vision.detect.rim_samples import Rimmed, RimSamples
from services.vision.stereo import StereoModel

SAMPLES = 96
SEARCH_SAMPLES = 64
SKIP_CORNER_PX = 1.5
PRIOR_SLACK = 1.3
STARTS = 8
KEPT = 4
FIRST_WINDOWS_PX = (5.0, 4.0, 3.0)
LAST_WINDOWS_PX = (2.5, 2.0, 2.0)
STEP_WINDOWS_PX = (3.0, 2.5, 2.0, 2.0)
FINER_WINDOWS_PX = (3.0, 2.5, 2.0, 2.0)
SUPPORTED = 0.45
SAME_PX = 0.7
DIFFERENT_PX = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A pose at which the rim may be, and what speaks for it.

    `score` 0 to 1: the mean support over both pictures. `rim_m` (M, 3): places on the rim, hole frame, m, even along
    it; `support` (2, M): 0 to 1, how much of an edge the left and the right picture show at each.
    """

    pose_camera_hole: Pose
    score: float
    rim_m: Array
    support: Array

    @property
    def supported(self) -> tuple[float, float]:
        """The share of the rim that is seen in the left and in the right picture."""
        left, right = (self.support > SUPPORTED).mean(axis=1)
        return float(left), float(right)


def candidates(
    images: Sequence[Floats], stereo: StereoModel, hole: Rimmed, nominal: Pose, half_ranges: Array
) -> list[Candidate]:
    """Where the hole may be, best first. `images` left and right, (height, width) each, grey 0 to 255, linear in light;
    `nominal` is `pose_base_hole` by the cell's drawing, `half_ranges` (6,) how far it may be off, m and rad."""
    prior = stereo.pose_base_camera.inverse() @ nominal
    ranges = PRIOR_SLACK * np.asarray(half_ranges, float)
    pixel_m = _pixel_m(stereo, prior)
    coarse = RimSamples.of(hole, SEARCH_SAMPLES, SKIP_CORNER_PX * pixel_m)
    grid = SearchGrid.of(coarse, stereo, prior, ranges)
    windows = grid.windows()
    left, right = (
        Level.of(images[side], windows[side], grid.factors[side]) for side in range(2)
    )
    poses = Poses.of(best_starts((left, right), grid, STARTS))
    samples = RimSamples.of(hole, SAMPLES, SKIP_CORNER_PX * pixel_m)
    factors = [(factor + 1) // 2 for factor in grid.factors]
    first = True
    while True:
        levels = (
            Level.of(images[0], windows[0], factors[0]),
            Level.of(images[1], windows[1], factors[1]),
        )
        if first:
            poses = refined(levels, samples, stereo, poses, prior, ranges, FIRST_WINDOWS_PX)
            score = support(levels, samples, stereo, poses).mean(axis=(0, 2))
            poses = poses.taken(_apart(samples, stereo, poses, score, DIFFERENT_PX * min(factors))[:KEPT])
            poses = refined(levels, samples, stereo, poses, prior, ranges, LAST_WINDOWS_PX)
            poses = refined(levels, samples, stereo, poses, prior, ranges, STEP_WINDOWS_PX, by_steps=True)
        else:
            poses = refined(levels, samples, stereo, poses, prior, ranges, FINER_WINDOWS_PX, by_steps=True)
        first = False
        if max(factors) == 1:
            break
        factors = [(factor + 1) // 2 for factor in factors]
    seen = likeness(levels, samples, stereo, poses)
    score = seen.mean(axis=(0, 2))
    chosen = _apart(samples, stereo, poses, score, SAME_PX)
    return [Candidate(poses[index], float(score[index]), samples.at(0.5), seen[:, index]) for index in chosen]


def _apart(samples: RimSamples, stereo: StereoModel, poses: Poses, score: Array, least_px: float) -> list[int]:
    """Poses, best first, without those whose rim nowhere lies farther than that from a better one's."""
    where = stereo.project(poses.apply(samples.at(0.5)))
    result: list[int] = []
    for index in np.argsort(score)[::-1]:
        if all(np.abs(where[:, index] - where[:, other]).max() > least_px for other in result):
            result.append(int(index))
    return result


def _pixel_m(stereo: StereoModel, pose_camera_hole: Pose) -> float:
    """What one pixel of the coarser picture covers at the hole, m."""
    seen = stereo.project(pose_camera_hole.apply(np.array([[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0]])))
    return float(1e-3 / np.linalg.norm(seen[:, 1] - seen[:, 0], axis=-1).min())
