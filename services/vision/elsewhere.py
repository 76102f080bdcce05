"""Detects edges that differ from the drawing: both pictures show a straight edge beside it in the face's plane.

An object that covers the rim lies above the face, and the inside of the hole lies below it. Seen from two cameras,
their borders shift against the face; the border of a different outline does not.
"""

from __future__ import annotations

import cv2
import numpy as np

from services.vision.fit.quality import Quality
from services.vision.fit.rim import Rim
from services.vision.fit.solve import Fit, Images
from services.vision.fit.steps import sample
from services.vision.stereo import StereoModel

# share of a group's profiles: if fewer look like the rim in either picture, its edge is looked for elsewhere
MAX_SUPPORT = 0.6
# search reach to both sides, step, smoothing, and the distance that still counts as the drawn edge itself, m
REACH_M, STEP_M, SMOOTH_M, SELF_M = 10e-3, 0.125e-3, 0.25e-3, 1.7e-3
# anything that lies this near to another drawn edge belongs to that edge, m
OTHER_M = 1.2e-3
# largest disagreement of the two pictures on the place, m and px
AGREE_M, AGREE_PX = 0.15e-3, 0.25
# least height of the step, as a share of the rim's; least share of it common to all profiles along the edge; and the
# largest step allowed at the drawn edge, as a share of it
MIN_HEIGHT, MIN_ALIKE, MAX_DRAWN = 0.3, 0.75, 0.35


def edges_elsewhere(
    images: Images, stereo: StereoModel, rim: Rim, fit: Fit, quality: Quality
) -> list[tuple[int, float]]:
    """Groups of the rim whose edge lies elsewhere in the face's plane, and the offset outward, m."""
    found = []
    for group in np.flatnonzero(quality.support.max(axis=0) < MAX_SUPPORT):
        offset = _elsewhere(images, stereo, rim, fit, int(group), MIN_HEIGHT * quality.step_grey)
        if offset is not None:
            found.append((int(group), offset))
    return found


def _elsewhere(images: Images, stereo: StereoModel, rim: Rim, fit: Fit, group: int, height_grey: float) -> float | None:
    offsets = np.arange(-REACH_M, REACH_M + STEP_M / 2, STEP_M)
    points = rim.outer_m[group][:, None] + offsets[:, None] * rim.outward[group][:, None]
    seen = stereo.project(fit.state.pose_camera_hole.apply(points))
    pixel_m = STEP_M / float(np.median(np.linalg.norm(np.diff(seen, axis=2), axis=-1)))
    free = np.abs(offsets) > SELF_M
    others = np.delete(rim.outer_m, group, axis=0).reshape(-1, 3)
    apart = np.linalg.norm(points.reshape(-1, 1, 3) - others, axis=-1).min(axis=1).reshape(points.shape[:2])
    free &= np.median(apart, axis=0) > OTHER_M
    if not free.any():
        return None
    places, ways = [], []
    for side in range(2):
        grey = sample(images[side], seen[side])
        slopes = cv2.GaussianBlur(np.gradient(grey, axis=1), (0, 0), SMOOTH_M / STEP_M, sigmaY=1e-3)
        mean, drawn = slopes.mean(axis=0), grey.mean(axis=0)[np.abs(offsets) < SELF_M]
        at = int(np.argmax(np.where(free, np.abs(mean), 0.0)))
        near = slice(max(at - int(1e-3 / STEP_M), 0), at + int(1e-3 / STEP_M) + 1)
        heights = slopes[:, near].sum(axis=1)
        whole = float(np.mean(heights))
        if (
            abs(whole) < height_grey
            or np.ptp(drawn) > MAX_DRAWN * abs(whole)
            or at in (0, len(offsets) - 1)
            or not free[at]
        ):
            return None
        if np.mean(heights * np.sign(whole) > 0.5 * abs(whole)) < MIN_ALIKE:
            return None
        around = np.abs(mean[at - 1 : at + 2])
        bend = around[0] - 2.0 * around[1] + around[2]
        places.append(offsets[at] + (0.5 * STEP_M * (around[0] - around[2]) / bend if bend < 0.0 else 0.0))
        ways.append(np.sign(whole))
    if ways[0] != ways[1] or abs(places[0] - places[1]) > max(AGREE_M, AGREE_PX * pixel_m):
        return None
    return float(np.mean(places))
