"""The repeatability of T2 on a cell without a known truth: the spread of the poses found by many assemblies. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose


class Repeatability(BaseModel):
    """Spread of found poses about their mean, in the mean hole's frame.

    Sample standard deviations of each axis; `lateral` and `tilt` are the root of the sum over x and y. The turn about
    the axis counts up to the peg's own symmetry.
    """

    model_config = ConfigDict(frozen=True)

    count: int
    sd_lateral_mm: float
    sd_depth_mm: float
    sd_tilt_deg: float
    sd_turn_deg: float | None  # None for a round peg, whose rotation cannot be seen
    largest_lateral_mm: float
    largest_rotation_deg: float


def repeatability(poses_base_hole: Sequence[Pose], symmetry_order: int = 4) -> Repeatability | None:
    """None for fewer than two poses; they say nothing about spread."""
    if len(poses_base_hole) < 2:
        return None
    first = poses_base_hole[0]
    alike = [_nearest_turn(first, pose, symmetry_order) for pose in poses_base_hole]
    centre = Pose(
        Rotation.from_matrix(np.array([pose.rotation for pose in alike])).mean().as_matrix(),
        np.mean([pose.translation_m for pose in alike], axis=0),
    )
    off = [centre.inverse() @ pose for pose in alike]
    shifts_mm = np.array([pose.translation_m for pose in off]) * 1e3
    turns_deg = np.rad2deg([pose.rotvec_rad() for pose in off])
    sd_mm, sd_deg = (_sd(values) for values in (shifts_mm, turns_deg))
    whole_deg = turns_deg[:, :2] if symmetry_order == 0 else turns_deg
    return Repeatability(
        count=len(alike),
        sd_lateral_mm=float(np.hypot(sd_mm[0], sd_mm[1])),
        sd_depth_mm=float(sd_mm[2]),
        sd_tilt_deg=float(np.hypot(sd_deg[0], sd_deg[1])),
        sd_turn_deg=None if symmetry_order == 0 else float(sd_deg[2]),
        largest_lateral_mm=float(np.linalg.norm(shifts_mm[:, :2], axis=1).max()),
        largest_rotation_deg=float(np.linalg.norm(whole_deg, axis=1).max()),
    )


def _sd(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """The standard deviations (3,) of samples (n, 3) about their mean, which is zero up to the rounding of a mean
    rotation.
    """
    return np.asarray(np.sqrt(np.sum(values**2, axis=0) / (len(values) - 1)))


def _nearest_turn(reference: Pose, pose: Pose, symmetry_order: int) -> Pose:
    """The pose rotated about its own axis by the section's symmetry to be nearest to the reference."""
    if symmetry_order == 0:
        x, y = (reference.rotation[:, 0] @ pose.rotation[:, column] for column in (0, 1))
        angles = [float(np.arctan2(y, x))]
    else:
        angles = [2.0 * np.pi * turn / symmetry_order for turn in range(symmetry_order)]
    turned = [pose @ Pose.from_rotvec([0.0, 0.0, angle], np.zeros(3)) for angle in angles]
    return min(turned, key=reference.angle_to_rad)
