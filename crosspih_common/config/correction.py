"""How a sensor is mounted against what its calibration or drawing says."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config.section import Section
from crosspih_common.geometry import Pose
from crosspih_common.messages.base import Vector3


class MountingCorrection(Section):
    """Where a frame really is, seen from where it was taken to be; none by default. `crosspih calibrate refine` finds
    it."""

    shift_m: Vector3 = (0.0, 0.0, 0.0)
    turn_rad: Vector3 = Field(default=(0.0, 0.0, 0.0), description="rotation vector")

    def pose(self) -> Pose:
        """`pose_taken_real`: the identity where there is no correction."""
        return Pose.from_rotvec(self.turn_rad, self.shift_m)
