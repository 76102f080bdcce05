"""Inverse kinematics of any arm: joint angles for a flange pose, near a seed and inside the limits.

An arm with the XB4's structure (6R, spherical wrist) is solved in closed form, every other numerically.

Errors: `InverseError` (ValueError)
    `Unreachable`  no joint angles inside the limits give this pose
    `BranchJump`   a path exists pose by pose, but not without a jump of the joints
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.arm.closed_form import ClosedForm
from crosspih_common.arm.errors import WITHOUT_PIN, BranchJump, InverseError, Unreachable
from crosspih_common.arm.kinematics import ArmModel
from crosspih_common.errors import ConfigError
from crosspih_common.geometry.pose import Array, Pose


class InverseKinematics(Protocol):
    """The inverse kinematics of one arm (protocol)."""

    def nearest(self, pose_base_flange: Pose, seed_joints_rad: ArrayLike) -> Array:
        """Joint angles (n,), rad, inside the limits near a seed (n,), rad, for a flange pose. Raises `Unreachable`,
        ValueError for a seed that is not n finite numbers."""
        ...

    def follow(self, pose_base_flange: Pose, seed_joints_rad: ArrayLike) -> Array:
        """As `nearest`, for a pose close to the seed's own pose: other branches of the arm are not searched."""
        ...

    def singular(self, joints_rad: ArrayLike) -> str:
        """Whether the arm is nearly singular at joint angles (n,), rad, in words; empty where it is not."""
        ...


@lru_cache(maxsize=16)
def solver(arm: ArmModel) -> InverseKinematics:
    """The inverse kinematics of an arm. Raises ConfigError where it needs `pin` and that is not installed."""
    try:
        return ClosedForm(arm)
    except ValueError:
        pass
    # pin is an optional extra: an installation that only uses an XB4 runs without it
    try:
        from crosspih_common.arm.numerical import Numerical
    except ImportError as error:
        raise ConfigError(f"cell.arm: {arm.name}: {WITHOUT_PIN} ({error})") from None
    return Numerical(arm)


def inverse(arm: ArmModel, pose_base_flange: Pose) -> list[Array]:
    """Every joint vector (6,), rad, inside the limits that puts the flange at a pose, in lexicographic order.

    Only for an arm that has a closed form; see `ClosedForm.solutions`. Raises `Unreachable` for a pose out of the arm's
    reach or not a rigid pose, ValueError for an arm of another kind.
    """
    return ClosedForm(arm).solutions(pose_base_flange)


def nearest(arm: ArmModel, pose_base_flange: Pose, seed_joints_rad: ArrayLike) -> Array:
    """The joint vector (n,), rad, inside the limits near a seed (n,), rad, for a flange pose.

    In closed form it is the nearest (Euclidean) of all; a seventh joint stays as near to the seed as the pose allows.
    Raises `Unreachable` naming what forbids the pose; ValueError for a seed that is not n finite numbers.
    """
    return solver(arm).nearest(pose_base_flange, seed_joints_rad)


def track(
    arm: ArmModel, poses_base_flange: Iterable[Pose], seed_joints_rad: ArrayLike, max_step_rad: float = 0.2
) -> Array:
    """Joint vectors (k, n), rad, along a path of k flange poses, each the nearest to the one before.

    The first pose may be any distance from the seed; after it a step of any joint above `max_step_rad` is a jump.
    Raises `BranchJump` with the index of the pose, `Unreachable` with the index in its text.
    """
    solve = solver(arm)
    path: list[Array] = []
    seed = np.asarray(seed_joints_rad, float)
    for index, pose in enumerate(poses_base_flange):
        try:
            joints = solve.follow(pose, seed) if path else solve.nearest(pose, seed)
        except Unreachable as error:
            raise Unreachable(f"pose {index} of the path: {error}") from error
        step = np.abs(joints - seed)
        if index > 0 and step.max() > max_step_rad:
            joint = int(step.argmax())
            cause = solve.singular(joints) or "onto another branch or near a singularity"
            raise BranchJump(
                f"pose {index} of the path: joint {joint + 1} would jump {step[joint]:.3f} rad ({cause}); "
                f"the limit is max_step_rad = {max_step_rad:g}",
                index,
            )
        path.append(joints)
        seed = joints
    if not path:
        raise ValueError("poses_base_flange is empty, want at least one pose")
    return np.array(path)


__all__ = [
    "BranchJump", "InverseError", "InverseKinematics", "Unreachable", "inverse", "nearest", "solver", "track",
]  # fmt: skip
