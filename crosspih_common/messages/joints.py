"""What the arm's encoders say."""

from __future__ import annotations

from crosspih_common.messages.base import Message, Vector6


class JointState(Message):
    """Motor-side joint angles: the elastic deflection of the joints and the wrist is not in them."""

    joints_rad: Vector6
    speeds_rad_s: Vector6
