"""`hardware.ros2` of a cell's file: which topics are the devices."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from crosspih_common.config.section import Section
from crosspih_common.ros2 import RosNetwork


class ArmTopics(Section):
    """An arm under ros2_control: joint_state_broadcaster, and a controller that takes set-points."""

    joint_states: str = "/joint_states"
    commands: str | None = Field(
        default=None,
        description="by `interface`: /forward_position_controller/commands, or joint_trajectory_controller's",
    )
    interface: Literal["positions", "trajectory"] = Field(
        default="positions", description="Float64MultiArray of positions, or JointTrajectory of one point"
    )
    joint_names: tuple[str, ...] | None = Field(
        default=None, description="base first, in the order of the controller's parameter `joints`"
    )
    rate_hz: float | None = Field(
        default=None, ge=50.0, le=1000.0, description="update_rate of the controller_manager; measured where not given"
    )
    lost_after_s: float = Field(default=0.25, gt=0.0, le=2.0, description="without a joint state: the arm is away")
    lead_s: float | None = Field(
        default=None, gt=0.0, le=0.2, description="time_from_start of a trajectory's point; two cycles where not given"
    )
    follow_within_rad: float = Field(
        default=0.15, gt=0.0, le=1.0, description="further than this from its set-point the arm follows it no more"
    )
    resume_within_rad: float = Field(
        default=0.02, gt=0.0, le=0.1, description="after the arm was away nothing is sent until it is as near as this"
    )


class WrenchTopic(Section):
    """A WrenchStamped topic, as force_torque_sensor_broadcaster publishes it: N and Nm, in the sensor's own frame."""

    topic: str = "/force_torque_sensor_broadcaster/wrench"
    rate_hz: float | None = Field(default=None, ge=20.0, le=8000.0, description="measured where not given")


class CameraTopics(Section):
    """Two Image topics with their camera_infos."""

    left: str = "/camera/left/image_raw"
    right: str = "/camera/right/image_raw"
    left_info: str = "/camera/left/camera_info"
    right_info: str = "/camera/right/camera_info"
    rectified: bool = Field(default=False, description="the pictures are rectified (image_rect): P is the camera")
    calibration: Path | None = Field(
        default=None, description="that of `crosspih calibrate hand-eye`: it counts, and no camera_info is listened to"
    )
    exposure_s: float = Field(default=0.02, gt=0.0, le=10.0, description="said to be the usual exposure")
    pair_within_s: float = Field(
        default=0.005, ge=0.0, le=0.1, description="stamps of a pair differ by so much at most"
    )
    skip_pairs: int = Field(default=1, ge=0, le=10, description="pairs after a request that may be from before it")
    wait_s: float = Field(default=3.0, gt=0.0, le=30.0, description="for a pair, before the camera counts as away")


class Ros2Config(RosNetwork):
    """The ROS 2 devices of a cell."""

    node: str = Field(default="crosspih_devices", pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", description="our node's name")
    connect_s: float = Field(default=10.0, gt=0.0, le=120.0, description="for the first sample of each topic")
    stamps: Literal["header", "arrival"] = Field(
        default="header",
        description="the messages' own times, moved to the cell's clock by one offset, or when they came here",
    )
    arm: ArmTopics = ArmTopics()
    force_torque: WrenchTopic = WrenchTopic()
    camera: CameraTopics = CameraTopics()
