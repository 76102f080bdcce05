"""The arm: its kinematics and limits, for all services that move it or need its pose."""

from crosspih_common.arm.kinematics import ArmModel, JointLimits
from crosspih_common.arm.named import NAMED_ARMS, NamedArm, named_arm, panda, ur5e, xb4

__all__ = ["NAMED_ARMS", "ArmModel", "JointLimits", "NamedArm", "named_arm", "panda", "ur5e", "xb4"]
