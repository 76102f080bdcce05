"""Where a thing is mounted or stands, as a cell's file says it."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config.section import Section
from crosspih_common.geometry import Pose
from crosspih_common.messages.base import Vector3


class Placement(Section):
    """A frame seen from another: where its origin is, and how it is turned. The identity by default."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    rotvec_rad: Vector3 = Field(default=(0.0, 0.0, 0.0), description="axis times angle")

    def pose(self) -> Pose:
        """The pose of the frame."""
        return Pose.from_rotvec(self.rotvec_rad, self.position_m)
