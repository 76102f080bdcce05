"""What an estimator and a network of one's own are: any callables, which inference loads by the cell's file.

`inference.estimator: my_lab.fit:estimate` answers in place of ours what the touches on the way in say of the hole, and
`inference.network: my_lab.net:predict` what the strategies `paper` and `network_spiral` ask. docs/extending.md shows
both. What they return is held to what a pose and a covariance can be; an exception of theirs refuses the command as
`own_code`, and the peg is taken out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import PosePrior, Touch


class TouchesToPose(Protocol):
    """An estimator."""

    def __call__(self, prior: PosePrior, touches: Sequence[Touch], workcell: Workcell) -> PosePrior:
        """The hole's pose in the base frame, with its covariance, from what was believed before and all touches of one
        assembly in order (poses motor-side, wrenches on the peg in the peg frame, N and Nm)."""


class WrenchToPose(Protocol):
    """A network, or any other regressor."""

    def __call__(self, wrench: Array, pose_peg_hole: Pose, workcell: Workcell) -> Pose:
        """The hole's pose in the peg frame at a touch, from the wrench (6,) on the peg about the peg frame's origin, N
        and Nm, and from where the hole was believed in that frame."""
