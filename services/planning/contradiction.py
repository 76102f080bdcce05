"""Whether the pose from touch and the pose from vision agree. Pure.

The errors of vision and touch are independent. So a camera or sensor whose mounting differs from the cell's file shows
as a contradiction between them, even if everything else works.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

# x and y across the hole's axis, and the tilts about them: what a bore's walls fix
ACROSS = [0, 1, 3, 4]
CONFIDENCE = 0.999
BOUND = float(chdtri(len(ACROSS), 1.0 - CONFIDENCE))  # the quantile of chi2


def nearest_turn(off: Pose, symmetry_order: int) -> Pose:
    """`off` rotated about its own z axis by the symmetry rotation of the section that leaves the smallest rotation.

    symmetry_order: the number of symmetry rotations in a full turn (4 for a cross); 0 for a round peg, any rotation.
    """
    if symmetry_order == 0:
        # the least rotation whose axis has no part along z
        turn = float(np.arctan2(off.rotation[1, 0] - off.rotation[0, 1], off.rotation[0, 0] + off.rotation[1, 1]))
        return off @ _about_z(-turn)
    turns = [2.0 * np.pi * index / symmetry_order for index in range(symmetry_order)]
    candidates = [off @ _about_z(turn) for turn in turns]
    return min(candidates, key=lambda pose: float(np.linalg.norm(pose.rotvec_rad())))


def _about_z(turn_rad: float) -> Pose:
    return Pose.from_rotvec([0.0, 0.0, turn_rad], [0.0, 0.0, 0.0])


def squared_distance(seen: Pose, seen_covariance: ArrayLike, found: Pose, found_covariance: ArrayLike,
                     symmetry_order: int) -> tuple[float, Array, Array]:  # fmt: skip
    """How far two poses of the hole in the base are apart: the squared Mahalanobis distance over `ACROSS`, the
    differences (4,) and their standard deviations (4,), m and rad, in the frame of the pose that was seen.

    Covariances (6, 6), x, y, z, rx, ry, rz of each pose in its own frame, as in HoleEstimate.
    """
    off = seen.inverse() @ found
    turned = nearest_turn(off, symmetry_order)
    into_seen = np.zeros((6, 6))
    into_seen[:3, :3] = into_seen[3:, 3:] = off.rotation
    total = np.reshape(np.asarray(seen_covariance, float), (6, 6))
    total = total + into_seen @ np.reshape(np.asarray(found_covariance, float), (6, 6)) @ into_seen.T
    across = total[np.ix_(ACROSS, ACROSS)]
    difference = np.concatenate([turned.translation_m, turned.rotvec_rad()])[ACROSS]
    return float(difference @ np.linalg.solve(across, difference)), difference, np.sqrt(np.diag(across))


def contradiction(seen: Pose, seen_covariance: ArrayLike, found: Pose, found_covariance: ArrayLike,
                  symmetry_order: int) -> str | None:  # fmt: skip
    """A warning if fewer than one in a thousand sound assemblies have poses from vision and touch this far apart."""
    squared, difference, sd = squared_distance(seen, seen_covariance, found, found_covariance, symmetry_order)
    if squared <= BOUND:
        return None
    lateral, tilt = float(np.hypot(*difference[:2])), float(np.hypot(*difference[2:]))
    sd_lateral, sd_tilt = float(np.hypot(*sd[:2])), float(np.hypot(*sd[2:]))
    return (
        f"what was felt contradicts what was seen: T2 is {lateral * 1e3:.3g} mm and {np.rad2deg(tilt):.3g} degrees "
        f"from vision's pose, whose difference should be known to {sd_lateral * 1e3:.2g} mm and "
        f"{np.rad2deg(sd_tilt):.2g} degrees (sd); squared distance {squared:.0f}, bound {BOUND:.1f}. Look at how the "
        "cameras are mounted (cell.camera, `crosspih calibrate refine`) and how the sensor is (cell.force_torque), "
        "and run `crosspih cell check`"
    )
