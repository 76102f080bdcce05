"""What is compared on connecting: the robot's type, its control mode, its flange, its payload, its speed.

Each returns what is wrong, with the setting and the mend, or None. Nothing here talks to anything.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.geometry import Pose

_STANDARD_GRAVITY = 9.80665


def wrong_model(arm_name: str, robot_model: str, version: tuple[int, ...]) -> str | None:
    """The arm of the cell's file against what the dashboard says: UR3, UR5, UR10, UR16, UR20 ... without the e."""
    asked = re.fullmatch(r"ur(\d+)(e?)", arm_name.strip().lower())
    found = re.match(r"ur\s*(\d+)", robot_model.strip().lower())
    if asked is None or found is None:
        return None  # an arm by its table or URDF has any name: its flange is compared all the same
    series = "e" if version[0] >= 5 else ""
    if asked[1] != found[1] or (asked[2] and not series):
        there = f"a {robot_model.strip()}{series} (PolyScope {version[0]}.{version[1]})"
        return f"cell.arm: name {arm_name} stands in the cell's file, and {there} answers: name the arm that is there"
    return None


def not_remote(answer: str, version: tuple[int, ...]) -> str | None:
    """Below 5.6 the dashboard does not know the question, and no mode keeps programs out."""
    if version[:2] >= (5, 6) and "true" not in answer.lower():
        return (
            "the robot is in local control and takes no programs: enable remote control (pendant: Settings, System, "
            "Remote Control), then choose it at the top right"
        )
    return None


def flange_by(tcp_pose: Sequence[float], tcp_offset: Sequence[float]) -> Pose:
    """`pose_base_flange` as the controller says it, of its TCP's pose and that TCP's place on the flange."""
    tcp = Pose.from_rotvec(np.asarray(tcp_pose[3:]), np.asarray(tcp_pose[:3]))
    return tcp @ Pose.from_rotvec(np.asarray(tcp_offset[3:]), np.asarray(tcp_offset[:3])).inverse()


def wrong_flange(model: ArmModel, joints_rad: Sequence[float], flange: Pose, tolerance_m: float) -> str | None:
    """Where `cell.arm` puts the flange, against where the controller does."""
    off = model.pose_base_flange(np.asarray(joints_rad, float)).inverse() @ flange
    distance_m, angle_rad = float(np.linalg.norm(off.translation_m)), Pose.identity().angle_to_rad(off)
    if distance_m <= tolerance_m and angle_rad <= 2.0 * tolerance_m:  # 10 mrad for 5 mm: the lever of a long tool
        return None
    return (
        f"cell.arm: its kinematics put the flange {distance_m * 1e3:.1f} mm and {angle_rad * 1e3:.1f} mrad from where "
        "the controller says it is; name the arm that is there, or give its calibrated kinematics as cell.arm.dh or "
        "urdf (docs/arms.md); hardware.ur.flange_tolerance_m is what is allowed"
    )


def flange_note(model: ArmModel, joints_rad: Sequence[float], flange: Pose) -> str:
    """By how much a robot differs from the drawing of its type: each is calibrated, by up to some millimetres."""
    off = model.pose_base_flange(np.asarray(joints_rad, float)).inverse() @ flange
    return f"flange {float(np.linalg.norm(off.translation_m)) * 1e3:.2f} mm from where cell.arm has it"


def wrong_payload(found_kg: float, known_kg: float | None, tolerance_kg: float) -> str | None:
    """What the controller reckons with against what hangs there: a wrong one lets the arm sag, or stop by itself."""
    if known_kg is None or abs(found_kg - known_kg) <= tolerance_kg:
        return None
    return (
        f"the controller reckons with a payload of {found_kg:.2f} kg, and {known_kg:.2f} kg hang there "
        "(hardware.ur.payload_kg, else cell.force_torque.weighed_n): set it on the pendant, Installation, General, "
        "Payload"
    )


def known_payload_kg(payload_kg: float | None, weighed_n: float | None) -> float | None:
    """What the cell's file says that hangs on the flange, kg."""
    if payload_kg is not None:
        return payload_kg
    return None if weighed_n is None else weighed_n / _STANDARD_GRAVITY


def too_slow(speed_fraction: float) -> str | None:
    """The speed slider scales every set-point's way: the arm would lag ever more."""
    if speed_fraction >= 0.99:
        return None
    return f"the robot's speed slider stands at {speed_fraction * 100:.0f} %: set it to 100 % on the pendant"
