"""The arms that a cell's file may name.

Link radii are of capsules around the castings, read off the makers' drawings to a centimetre; they serve for clearance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import pi

import numpy as np

from crosspih_common.arm.kinematics import ArmModel, JointLimits
from crosspih_common.geometry.pose import Pose


@dataclass(frozen=True, slots=True)
class NamedArm:
    """An arm by its name, a home posture and the stiffness of its joints where a cell's file says nothing else.

    `stiffness_nm_rad` is the elasticity between the encoders and the links. It is an assumption that gives a stiffness
    of 50 to 150 N/mm at the tool; no maker of these arms publishes a value.
    """

    make: Callable[[], ArmModel]
    home_rad: tuple[float, ...]
    stiffness_nm_rad: tuple[float, ...]


@cache
def xb4() -> ArmModel:
    """The ROKAE XB4, build A (d1 = 0.342 m, d6 = 0.073 m); at zero the flange frame is [0 0 1; 0 -1 0; 1 0 0].

    The lengths of build A, the axes, limits, speeds and accelerations are from two public sources (an arm model with
    the maker's meshes, and a controller written for the real arm). Both are from third parties, not from a data sheet.
    """
    quarter = np.pi / 2
    dh = [
        [0.0, 0.342, 0.040, -quarter],
        [-quarter, 0.0, 0.275, 0.0],
        [0.0, 0.0, 0.025, -quarter],
        [0.0, 0.280, 0.0, quarter],
        [0.0, 0.0, 0.0, -quarter],
        [0.0, 0.073, 0.0, 0.0],
    ]
    limits = JointLimits(
        lower_rad=np.deg2rad([-170.0, -84.0, -188.0, -170.0, -117.0, -360.0]),
        upper_rad=np.deg2rad([170.0, 130.0, 50.0, 170.0, 117.0, 360.0]),
        speed_rad_s=np.deg2rad([310.0, 240.0, 310.0, 250.0, 295.0, 500.0]),
        acceleration_rad_s2=np.deg2rad([1500.0, 1500.0, 1500.0, 1750.0, 1500.0, 2500.0]),
    )
    return ArmModel.from_dh("xb4", dh, limits, link_radii_m=[0.09, 0.065, 0.06, 0.05, 0.04, 0.035])


@cache
def ur5e() -> ArmModel:
    """The Universal Robots UR5e.

    Standard DH table and joint limits: Universal Robots, "DH Parameters for calculations of kinematics and dynamics"
    and the UR5e's data sheet (elbow +-180 degrees as in the maker's ROS description; 180 degrees/s each). The maker
    publishes no acceleration: a quarter of the 40 rad/s^2 that its controller accepts (ur_rtde).
    """
    quarter = np.pi / 2
    dh = [
        [0.0, 0.1625, 0.0, quarter],
        [0.0, 0.0, -0.425, 0.0],
        [0.0, 0.0, -0.3922, 0.0],
        [0.0, 0.1333, 0.0, quarter],
        [0.0, 0.0997, 0.0, -quarter],
        [0.0, 0.0996, 0.0, 0.0],
    ]
    turn = 2.0 * pi
    limits = JointLimits(
        lower_rad=np.array([-turn, -turn, -pi, -turn, -turn, -turn]),
        upper_rad=np.array([turn, turn, pi, turn, turn, turn]),
        speed_rad_s=np.full(6, pi),
        acceleration_rad_s2=np.full(6, 10.0),
    )
    lines = ArmModel.from_dh("ur5e", dh, limits).link_lines_m.copy()
    lines[1, :, 2], lines[2, :, 2] = 0.138, 0.007  # upper arm and forearm stand beside their DH lines
    return ArmModel.from_dh(
        "ur5e", dh, limits, link_radii_m=[0.075, 0.065, 0.06, 0.05, 0.05, 0.045], link_lines_m=lines
    )


@cache
def panda() -> ArmModel:
    """The Franka Emika Panda, seven joints.

    Modified DH table, flange, joint limits, speeds and accelerations: Franka Emika, "Franka Control Interface
    Documentation", Robot and interface specifications.
    """
    quarter = np.pi / 2
    modified = [
        [0.0, 0.333, 0.0, 0.0],
        [0.0, 0.0, 0.0, -quarter],
        [0.0, 0.316, 0.0, quarter],
        [0.0, 0.0, 0.0825, quarter],
        [0.0, 0.384, -0.0825, -quarter],
        [0.0, 0.0, 0.0, quarter],
        [0.0, 0.0, 0.088, quarter],
    ]
    limits = JointLimits(
        lower_rad=np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]),
        upper_rad=np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]),
        speed_rad_s=np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]),
        acceleration_rad_s2=np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
    )
    return ArmModel.from_modified_dh(
        "panda", modified, limits, pose_last_flange=Pose.from_translation([0.0, 0.0, 0.107]),
        link_radii_m=[0.08, 0.08, 0.07, 0.07, 0.08, 0.06, 0.05],
    )  # fmt: skip


NAMED_ARMS: dict[str, NamedArm] = {
    "xb4": NamedArm(
        xb4,
        (-1.44, 0.98, 0.09, -1.35, -1.62, -0.07),
        (20000.0, 20000.0, 15000.0, 5000.0, 5000.0, 2500.0),
    ),
    "ur5e": NamedArm(
        ur5e,
        (-0.48, -1.94, -1.89, 0.85, 2.0, -2.06),
        (30000.0, 60000.0, 40000.0, 10000.0, 10000.0, 6000.0),
    ),
    "panda": NamedArm(
        panda,
        (-0.78, -0.57, -0.11, -2.25, 1.81, 2.28, -2.42),
        (50000.0, 50000.0, 40000.0, 40000.0, 10000.0, 8000.0, 4000.0),
    ),
}


def named_arm(name: str) -> ArmModel:
    """The arm with this name. Raises ValueError that lists the known names."""
    if name not in NAMED_ARMS:
        raise ValueError(f"no arm is named {name!r}; want one of {', '.join(NAMED_ARMS)}")
    return NAMED_ARMS[name].make()
