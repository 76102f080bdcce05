"""Rigid-body geometry: poses and the wrenches and compliances that move between frames."""

from crosspih_common.geometry.pose import Pose, rotation_from_error_angles, rotation_to_error_angles
from crosspih_common.geometry.wrench import (
    adjoint_wrench,
    skew,
    transform_wrench,
    wrench_of_force_at_point,
)

__all__ = [
    "Pose",
    "adjoint_wrench",
    "rotation_from_error_angles",
    "rotation_to_error_angles",
    "skew",
    "transform_wrench",
    "wrench_of_force_at_point",
]
