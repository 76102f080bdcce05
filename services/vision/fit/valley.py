"""The flatness of the likelihood some way aside of the fit; the fit's own covariance tells only its curvature there.

In a blurred picture the chamfer's two steps run into one: a rim farther out with a darker chamfer looks much the same.
The slope at the end of the fit does not show this, because the prior keeps the effects of the edges small there. A
quarter of a millimetre aside, with everything but the pose fitted anew, the pictures are still explained almost as well
(the profile likelihood: Venzon and Moolgavkar 1988).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.climb import unlikely
from services.vision.fit.rim import Rim, perturbed
from services.vision.fit.solve import Doubts, Fit, Images, look, stepped
from services.vision.stereo import StereoModel

# blur, sd, as a share of the chamfer's width, above which this check is made
BLURRED = 0.55
ASIDE_M = 0.25e-3
# relative increase of the misfit at one sd; measured on pictures of rims
WORSE_AT_SD = 0.015
MIN_WORSE = 1e-4


def blurred(fit: Fit) -> bool:
    """Whether one picture's blur, in its widest direction, is wide enough to merge a chamfer's two steps."""
    covariances = fit.state.blur_px2[:, [0, 1, 1, 2]].reshape(2, 2, 2)
    widest = np.sqrt(np.linalg.eigvalsh(covariances)[:, -1].max())
    return bool(widest > BLURRED * float(np.median(fit.seen.chamfer_px)))


def with_valleys(covariance: Array, images: Images, rim: Rim, stereo: StereoModel, fit: Fit, doubts: Doubts) -> Array:
    """The covariance (6, 6), m and rad, widened in x and y to the profile likelihood at ASIDE_M; unchanged in a sharp
    picture."""
    if not blurred(fit):
        return covariance
    pose, least = fit.state.pose_camera_hole, unlikely(fit, fit.even, doubts)
    widened = covariance.copy()
    variances, axes = np.linalg.eigh(covariance[:2, :2])
    for variance, axis in zip(variances, axes.T, strict=True):
        # the most likely pose if it lies aside by one metre along the axis
        way = covariance[:, :2] @ axis / variance
        seen_m2 = []
        for aside_m in (-ASIDE_M, ASIDE_M):
            there = replace(fit.state, pose_camera_hole=perturbed(pose, aside_m * way))
            # one step of everything but the pose
            there = stepped(rim, look(images, rim, stereo, there), doubts, hold_pose=True)[0]
            worse = unlikely(look(images, rim, stereo, there), fit.even, doubts) / least - 1.0
            seen_m2.append(ASIDE_M**2 * min(WORSE_AT_SD / max(worse, MIN_WORSE), 1.0))
        widened += max(float(np.mean(seen_m2)) - float(variance), 0.0) * np.outer(way, way)
    return widened
