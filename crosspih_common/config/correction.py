"""The correction of a sensor's mounting relative to its calibration or drawing."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config.section import Section
from crosspih_common.geometry import Pose
from crosspih_common.messages.base import Vector3


class MountingCorrection(Section):
    """The real pose of a frame relative to its assumed pose; by default the identity. `crosspih calibrate refine`
    measures it."""

    shift_m: Vector3 = (0.0, 0.0, 0.0)
    turn_rad: Vector3 = Field(default=(0.0, 0.0, 0.0), description="rotation vector")

    def pose(self) -> Pose:
        """`pose_taken_real`: the identity where there is no correction."""
        return Pose.from_rotvec(self.turn_rad, self.shift_m)
