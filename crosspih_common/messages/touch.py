"""One touch: everything that an estimate may rest on."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.messages.base import (
    MAX_SEQ,
    Deviations6,
    Direction,
    Frame,
    Joints,
    Message,
    Number,
    PoseData,
    Vector6,
)
from crosspih_common.messages.contact import ContactState


class Touch(Message):
    """A contact as felt. Poses are motor-side; the wrench is on the peg, in the peg frame."""

    frame: Frame = Frame.PEG
    index: int = Field(ge=0, le=MAX_SEQ)
    seated: bool = Field(default=False, description="pressed against a wall of the bore, the peg already in")
    pose_base_peg: PoseData = Field(description="mean pose over the samples of the wrench")
    pose_base_peg_first_contact: PoseData | None = None
    travel_first_contact_m: Number | None = None
    direction_base: Direction
    joints_rad: Joints
    wrench: Vector6
    wrench_sd: Deviations6
    state: ContactState
