"""What to do when a push stalls with the peg already in its bore."""

from __future__ import annotations

from enum import Enum

from pydantic import Field

from crosspih_common.messages.base import MAX_MAGNITUDE, Covariance6, Frame, Joints, Message, PoseData, Vector6
from crosspih_common.messages.estimate import PosePrior


class BoreContact(str, Enum):
    """How the peg's body stands in its bore."""

    OUTSIDE = "outside"  # the body is not in the bore: the taper, the chamfer or the face touches
    FREE = "free"  # no wall is felt
    ONE_POINT = "one_point"  # walls press at one height: at the rim or at the body's leading end
    TWO_POINT = "two_point"  # walls press at both heights, and the push still slides the peg in
    JAMMED = "jammed"  # the lateral load makes more friction than the push overcomes
    WEDGED = "wedged"  # two opposite contacts see each other in their friction cones: pushing only clamps


class InsertionAction(str, Enum):
    """What to do next."""

    CONTINUE = "continue"  # push on, with `push_force_n`
    LOWER_PUSH = "lower_push"  # push on with the lower `push_force_n`: the push itself makes the load
    BACK_OFF = "back_off"  # go to `pose_base_peg`, aligned with the bore, and push again with `push_force_n`


class AdviseInsertion(Message):
    """A push stalled: what the peg feels and where it is (motor-side), and with what force it was pushed."""

    belief: PosePrior
    pose_base_peg: PoseData
    joints_rad: Joints
    wrench: Vector6 = Field(description="contact wrench on the peg, in the peg frame")
    push_force_n: float = Field(gt=0.0, le=MAX_MAGNITUDE, description="the axial force that the push went up to")
    force_limit_n: float = Field(
        default=20.0, gt=0.0, le=MAX_MAGNITUDE, description="the largest axial force of any push"
    )
    friction: float | None = Field(default=None, ge=0.0, le=1.0, description="None: the cell's expected one")


class InsertionAdvice(Message):
    """How the peg stands in its bore, and what to do.

    `pose_base_hole` is the belief fused with the peg's own pose in the bore; `pose_base_peg` is on that bore's axis,
    `back_off_m` further out than the peg is now.
    """

    frame: Frame = Frame.BASE
    contact: BoreContact
    action: InsertionAction
    reason: str
    entered_m: float = Field(description="depth of the body in its bore; negative: short of it")
    push_force_n: float
    needed_force_n: float = Field(description="axial force from which the peg slides on under the load felt now")
    rim_force_n: float = Field(description="what the walls press at the rim")
    leading_force_n: float = Field(description="what they press at the body's leading end")
    back_off_m: float
    pose_base_peg: PoseData
    pose_base_hole: PoseData
    covariance: Covariance6
