"""An estimator of one's own on the touches: each says that the hole is off to the side from which the peg is pushed.

    inference: {estimator: "my_lab.fit:estimate"}

A linear-Gaussian update of what was believed: crude, and so a floor for what mechanics must beat.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import PoseData, PosePrior, Touch, floats

STEP_M = 0.0006  # how far off a rim that pushes sideways is taken to be
SD_M = 0.0008  # and how sure that is


def estimate(prior: PosePrior, touches: Sequence[Touch], workcell: Workcell) -> PosePrior:
    """The hole in the base frame, with its covariance."""
    hole = prior.pose_base_hole.pose()
    covariance = np.asarray(prior.covariance).reshape(6, 6)
    mean = np.zeros(6)  # in the hole frame: x, y, z, rx, ry, rz
    looks = np.eye(6)[:2]
    for touch in touches:
        force_hole = hole.rotation.T @ touch.pose_base_peg.pose().rotation @ np.asarray(touch.wrench[:3])
        side = float(np.hypot(*force_hole[:2]))
        if side < 0.5:
            continue
        measured = STEP_M * force_hole[:2] / side
        gain = covariance @ looks.T @ np.linalg.inv(looks @ covariance @ looks.T + SD_M**2 * np.eye(2))
        mean = mean + gain @ (measured - looks @ mean)
        covariance = (np.eye(6) - gain @ looks) @ covariance
    covariance = 0.5 * (covariance + covariance.T)
    moved = hole @ Pose.from_rotvec(mean[3:], mean[:3])
    return PosePrior(pose_base_hole=PoseData.of(moved), covariance=floats(covariance))
