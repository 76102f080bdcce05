"""The 6-axis arm: its kinematics and limits, shared by whoever moves it or reasons about where it is."""

from crosspih_common.arm.kinematics import ArmModel, JointLimits, xb4

__all__ = ["ArmModel", "JointLimits", "xb4"]
