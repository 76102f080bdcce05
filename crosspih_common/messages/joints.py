"""What the arm's encoders say."""

from __future__ import annotations

from pydantic import model_validator

from crosspih_common.messages.base import Joints, Message, same_length


class JointState(Message):
    """Motor-side joint angles: the elastic deflection of the joints and the wrist is not in them."""

    joints_rad: Joints
    speeds_rad_s: Joints

    @model_validator(mode="after")
    def _of_one_arm(self) -> JointState:
        same_length(self, "joints_rad", "speeds_rad_s")
        return self
