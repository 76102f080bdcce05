"""Errors of the inverse kinematics.

`InverseError` (ValueError)
    `Unreachable`  no joint angles inside the limits give this pose
    `BranchJump`   a path exists pose by pose, but not without a jump of the joints
"""

from __future__ import annotations

WITHOUT_PIN = "an arm that is no XB4 needs the package pin: make env installs it, or pip install 'crosspih[arms]'"
"""What is said where Pinocchio is not installed."""


class InverseError(ValueError):
    """Inverse kinematics could not answer."""


class Unreachable(InverseError):
    """No joint angles inside the limits give this pose; the message says why."""


class BranchJump(InverseError):
    """The joints would have to jump between two neighbouring poses of a path; `index` is the later one's."""

    def __init__(self, message: str, index: int) -> None:
        super().__init__(message)
        self.index = index
