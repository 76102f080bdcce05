"""Where one thing is mounted on another."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config.section import Section
from crosspih_common.geometry import Pose
from crosspih_common.messages.base import Vector3


class Placement(Section):
    """A pose as a cell's file gives it; the field that holds it names both frames."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    rotvec_rad: Vector3 = Field(default=(0.0, 0.0, 0.0), description="axis times angle")

    def pose(self) -> Pose:
        """The pose; exactly a translation if the rotation is zero."""
        if not any(self.rotvec_rad):
            return Pose.from_translation(list(self.position_m))
        return Pose.from_rotvec(self.rotvec_rad, self.position_m)
