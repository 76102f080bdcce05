"""Forward kinematics, Jacobian and limits of a 6R arm from standard DH parameters.

The ROKAE XB4: lengths of build A and the axes, limits, speeds and accelerations of two public sources (an arm model
with the maker's meshes, and a controller written for the real arm); they are a third party's, not a data sheet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array, Pose


@dataclass(frozen=True, slots=True, eq=False)
class JointLimits:
    """Limits of every joint, each (6,): rad, rad/s, rad/s^2."""

    lower_rad: Array
    upper_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array

    def violations(self, joints_rad: ArrayLike, slack_rad: float = 1e-9) -> list[str]:
        """One clear line a joint that is outside its range or not finite; empty when all are inside."""
        joints = np.asarray(joints_rad, float)
        if joints.shape != (6,):
            return [f"joints_rad wants 6 numbers, got shape {joints.shape}"]
        lines = []
        for index, value in enumerate(joints):
            low, high = self.lower_rad[index], self.upper_rad[index]
            if not np.isfinite(value):
                lines.append(f"joint {index + 1} is {value}, want a finite angle")
            elif not low - slack_rad <= value <= high + slack_rad:
                lines.append(f"joint {index + 1} at {value:.4f} rad is outside [{low:.4f}, {high:.4f}]")
        return lines


@dataclass(frozen=True, slots=True, eq=False)
class ArmModel:
    """A 6R arm in standard DH: row i is (theta offset, d, a, alpha), rad and m, from base {S} to flange.

    `dh` is (6, 4). Each link's transform is Rz(q + offset) Tz(d) Tx(a) Rx(alpha) (Craig/Spong standard convention).
    """

    name: str
    dh: Array
    limits: JointLimits

    def link_poses(self, joints_rad: ArrayLike) -> list[Pose]:
        """`pose_base_link` of the seven frames 0 (base) to 6 (flange) at joint angles (6,), rad."""
        joints = np.asarray(joints_rad, float)
        poses = [Pose.identity()]
        rotation, position = np.eye(3), np.zeros(3)
        for (offset, d, a, alpha), joint in zip(self.dh, joints, strict=True):
            ct, st = np.cos(joint + offset), np.sin(joint + offset)
            ca, sa = np.cos(alpha), np.sin(alpha)
            step = np.array([[ct, -st * ca, st * sa], [st, ct * ca, -ct * sa], [0.0, sa, ca]])
            position = position + rotation @ np.array([a * ct, a * st, d])
            rotation = rotation @ step
            poses.append(Pose(rotation, position))
        return poses

    def pose_base_flange(self, joints_rad: ArrayLike) -> Pose:
        """Forward kinematics: the flange in the base frame {S} at joint angles (6,), rad."""
        return self.link_poses(joints_rad)[6]

    def jacobian(self, joints_rad: ArrayLike, pose_flange_point: Pose | None = None) -> Array:
        """The geometric Jacobian (6, 6) in the base frame: rows vx vy vz wx wy wz, of a point fixed to the flange."""
        poses = self.link_poses(joints_rad)
        tip = poses[6] if pose_flange_point is None else poses[6] @ pose_flange_point
        columns = []
        for index in range(6):
            axis = poses[index].rotation[:, 2]
            columns.append(np.concatenate([np.cross(axis, tip.translation_m - poses[index].translation_m), axis]))
        return np.array(columns).T


def xb4() -> ArmModel:
    """The ROKAE XB4, build A (d1 = 0.342 m, d6 = 0.073 m); at zero the flange frame is [0 0 1; 0 -1 0; 1 0 0]."""
    quarter = np.pi / 2
    dh = np.array(
        [
            [0.0, 0.342, 0.040, -quarter],
            [-quarter, 0.0, 0.275, 0.0],
            [0.0, 0.0, 0.025, -quarter],
            [0.0, 0.280, 0.0, quarter],
            [0.0, 0.0, 0.0, -quarter],
            [0.0, 0.073, 0.0, 0.0],
        ]
    )
    limits = JointLimits(
        lower_rad=np.deg2rad([-170.0, -84.0, -188.0, -170.0, -117.0, -360.0]),
        upper_rad=np.deg2rad([170.0, 130.0, 50.0, 170.0, 117.0, 360.0]),
        speed_rad_s=np.deg2rad([310.0, 240.0, 310.0, 250.0, 295.0, 500.0]),
        acceleration_rad_s2=np.deg2rad([1500.0, 1500.0, 1500.0, 1750.0, 1500.0, 2500.0]),
    )
    return ArmModel("xb4", dh, limits)
