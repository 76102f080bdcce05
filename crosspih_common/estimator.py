"""The protocols of a user's own estimator and network: any callables, which inference loads by the cell's file.

`inference.estimator: my_lab.fit:estimate` replaces our estimate of the hole's pose from the touches, and
`inference.network: my_lab.net:predict` the network of the strategies `paper` and `network_spiral`. docs/extending.md
shows both. Their results must be a valid pose and covariance. If they raise an exception, the command is refused as
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
        """The hole's pose in the base frame, with its covariance, from the prior and all touches of one assembly in
        order (poses motor-side, wrenches on the peg in the peg frame, N and Nm)."""


class WrenchToPose(Protocol):
    """A network, or any other regressor."""

    def __call__(self, wrench: Array, pose_peg_hole: Pose, workcell: Workcell) -> Pose:
        """The hole's pose in the peg frame at a touch, from the wrench (6,) on the peg about the peg frame's origin, N
        and Nm, and from the hole's previously estimated pose in that frame."""
