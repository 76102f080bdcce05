"""A worse camera, for experiments: an error of given size added to the pose found, and to its covariance.

The error is drawn from the two pictures themselves, so that the same pictures always give the same answer, also when
they come from a recording, and two looks at the same hole give two draws.
"""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.messages.images import Pixels
from services.vision.config import ExtraNoise
from services.vision.locate import Located


def disturbed(found: Located, noise: ExtraNoise, left: Pixels, right: Pixels, orientation_measured: bool) -> Located:
    """`found` with the noise added (right perturbation: x, y, z, rx, ry, rz of the hole frame); itself where it is 0.

    A method that assumes the orientation has no orientation to disturb.
    """
    turn_rad = noise.rotation_rad if orientation_measured else 0.0
    sd = np.array([noise.lateral_m, noise.lateral_m, noise.depth_m, turn_rad, turn_rad, turn_rad])
    if not sd.any():
        return found
    seeds = [zlib.crc32(picture.tobytes()) for picture in (left, right)]
    error = np.random.default_rng(seeds).normal(size=6) * sd
    return replace(
        found,
        pose_base_hole=found.pose_base_hole @ Pose.from_rotvec(error[3:], error[:3]),
        covariance=found.covariance + np.diag(sd**2),
    )
