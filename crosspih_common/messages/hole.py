"""Where the hole is, as the cameras see it."""

from __future__ import annotations

from enum import Enum

from pydantic import Field

from crosspih_common.messages.base import Covariance6, Frame, Message, PoseData


class LocateMethod(str, Enum):
    """How the hole is located."""

    RIM = "rim"  # sub-pixel fit of the rim in both images: 6-DoF pose with covariance
    PAPER = "paper"  # Eqs. 1-9 as printed: centre by disparity, orientation assumed


class LocateHole(Message):
    """Take a pair and locate the hole in it."""

    method: LocateMethod = LocateMethod.RIM


class HoleEstimate(Message):
    """The hole's pose with its covariance (order x, y, z, rx, ry, rz in the hole frame)."""

    frame: Frame = Frame.BASE
    pose_base_hole: PoseData
    covariance: Covariance6
    method: LocateMethod
    orientation_measured: bool = Field(description="False where the method assumes the nominal orientation")
    capture_id: int
    capture_wall_s: float = Field(description="wall time spent by the camera, not by vision")
    diagnostics: dict[str, float] = Field(default_factory=dict)
    warnings: tuple[str, ...] = Field(default=(), description="what a person should know although there is a pose")
