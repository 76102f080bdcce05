"""The bridge's section of a cell's file."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from crosspih_common.messages import Strategy
from crosspih_common.ros2 import RosNetwork

ROS2_DRIVER = "ros2"


def devices_of_ros(hardware: dict[str, Any]) -> frozenset[str]:
    """The devices among arm, force_torque and camera that belong to ROS 2, by the cell file's raw section `hardware`.

    Their data are in ROS already, and are not published there twice.
    """
    drivers = hardware.get("drivers") or {}
    names = ("arm", "force_torque", "camera")
    return frozenset(name for name in names if (drivers.get(name) or hardware.get("driver")) == ROS2_DRIVER)


class BridgeConfig(RosNetwork):
    """Where ROS runs, the cell's names there, and whether ROS may request an assembly."""

    node: str = Field(default="crosspih", pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", description="the node's name")
    joint_names: tuple[str, ...] | None = Field(
        default=None, description="base first; the maker's of a named arm, or joint_1, joint_2 ..., where not given"
    )
    base_frame: str | None = Field(default=None, description="base_link where not given")
    flange_frame: str | None = Field(default=None, description="tool0 where not given")
    tf_hz: float = Field(default=50.0, ge=0.0, le=500.0, description="of the arm's links on /tf; 0: no /tf of the arm")
    stamps: Literal["wall", "cell"] = Field(
        default="wall", description="the cell's clock mapped to the wall's, or as it is"
    )
    commands: bool = Field(
        default=True,
        description="whether ROS may ask for an assembly, a withdrawal, and their end",
    )
    strategy: Strategy = Field(default=Strategy.FUSED, description="of an assembly that ROS asks for")
