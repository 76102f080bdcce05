"""What the touches say about the pose."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.messages.base import (
    MAX_SEQ,
    Covariance6,
    Direction,
    Frame,
    Joints,
    Message,
    Part,
    PoseData,
    PriorCovariance6,
    Vector3,
    Vector6,
)
from crosspih_common.messages.touch import Touch

MAX_TOUCHES = 100


class PosePrior(Part):
    """Where the hole is believed to be before any touch (covariance as in HoleEstimate)."""

    pose_base_hole: PoseData
    covariance: PriorCovariance6


class EstimatePose(Message):
    """Fuse all touches of one assembly; the request holds all that the answer depends on."""

    prior: PosePrior
    touches: tuple[Touch, ...] = Field(min_length=1, max_length=MAX_TOUCHES)


class TouchUse(Part):
    """What became of one touch in the fit."""

    index: int
    used: bool
    hypothesis: str = Field(description="the features that the fit assumes to be in contact")
    residual_sigma: float = Field(description="root mean square of its residuals, in standard deviations")


class PoseErrorEstimate(Message):
    """The fused pose of the hole, and the peg's error there as the paper counts it.

    `angles_rad` is (alpha, beta, gamma) and `translation_m` (x, y, z) of the hole in the peg frame at the last touch.
    """

    frame: Frame = Frame.BASE
    pose_base_hole: PoseData
    covariance: Covariance6
    angles_rad: Vector3
    translation_m: Vector3
    rank: int = Field(ge=0, le=6, description="number of directions in which the touches clearly narrowed the prior")
    residual_cost: float
    friction: float
    friction_sd: float
    method: str
    rests_on: tuple[TouchUse, ...]
    compute_s: float = Field(description="wall time of the computation")


class NextTouch(Message):
    """Ask where to push next, given what is believed now and how often pushing failed and touching was tried."""

    belief: PosePrior
    touches_made: int = Field(ge=0, le=MAX_SEQ)
    failed_pushes: int = Field(ge=0, le=MAX_SEQ)
    last_touch_used: bool = Field(default=True, description="False where the estimate could not explain the last touch")


class TouchPlan(Message):
    """The peg's pose to push from (the tip short of the rim), the way to push, and which idea this is."""

    frame: Frame = Frame.BASE
    pose_base_peg_start: PoseData
    direction_base: Direction
    idea: str


class EstimateByNetwork(Message):
    """The paper's way: one wrench to three angles by the network, then x and y by Eq. 24."""

    touch: Touch
    pose_base_hole_believed: PoseData


class EstimateBySequence(Message):
    """A learned way: all touches so far, in their order, through a recurrent network to the pose."""

    prior: PosePrior
    touches: tuple[Touch, ...] = Field(min_length=1, max_length=MAX_TOUCHES)


class EstimateSeated(Message):
    """The peg sits in the hole: its own pose is now the best measurement of the hole's, within the clearance."""

    prior: PosePrior
    pose_base_peg: PoseData
    joints_rad: Joints
    wrench: Vector6
