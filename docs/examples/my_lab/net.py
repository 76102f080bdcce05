"""A regressor of one's own behind `inference/network`: the peg is tilted the way in which the moment turns it.

inference: {network: "my_lab.net:predict"}
"""

from __future__ import annotations

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

GAIN_RAD_NM = 0.03  # fitted by eye
MAX_RAD = 0.05


def predict(wrench: Array, pose_peg_hole: Pose, workcell: Workcell) -> Pose:
    """The hole in the peg frame: where it was believed, turned about the tip by the moment there."""
    tip = np.array([0.0, 0.0, workcell.peg.shape().tip_m])
    moment_at_tip = wrench[3:] - np.cross(tip, wrench[:3])
    turn = GAIN_RAD_NM * np.array([moment_at_tip[0], moment_at_tip[1], 0.0])
    size = float(np.linalg.norm(turn))
    if size > MAX_RAD:
        turn *= MAX_RAD / size
    return Pose.from_rotvec(turn, tip) @ Pose.from_translation(-tip) @ pose_peg_hole
