"""The protocol of a user's own strategy and the tools it gets: the same as for built-in ones, under the same limits.

A strategy is a class without constructor arguments (or any callable without arguments). The `assemble(tools)` of its
object inserts the peg and returns the estimated pose of the hole with its covariance. Planning loads it by name,
`crosspih assemble --strategy my_lab.mine:Strategy`; docs/extending.md shows one.

Poses are `crosspih_common.geometry.Pose`: `pose_base_hole` is the hole in the base frame, z into the hole,
`pose_base_peg` the peg, z towards its tip. Lengths are m, forces N, moments Nm, speeds m/s; a covariance is (36,),
row by row, x, y, z, rx, ry, rz in the hole frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn, Protocol, runtime_checkable

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import (
    ContactReading,
    HoleEstimate,
    PathKnot,
    PoseErrorEstimate,
    PosePrior,
    Touch,
    TouchPlan,
)

ENTRY_POINTS = "crosspih.strategies"


class Tools(Protocol):
    """Vision, moves and estimates for one assembly. Every move is counted and published, a free move is checked for
    collisions, and the arm keeps the cell's force and moment caps. If a move is impossible or a service is lost, a
    planning exception is raised, which the strategy must not catch: the peg is then taken out."""

    @property
    def workcell(self) -> Workcell:
        """The cell's drawing."""

    @property
    def pose_base_peg(self) -> Pose:
        """Where the peg is now, motor-side."""

    @property
    def touches(self) -> tuple[Touch, ...]:
        """All touches of this assembly so far, in order."""

    def locate(self) -> HoleEstimate:
        """Ask vision for the hole. If it finds none the assembly ends as `not_seen`; nothing moves."""

    def approach(self, pose_base_hole: Pose) -> None:
        """Move from free space to before the hole: the peg aligned, its tip at the stand-off before the face."""

    def before_hole(self, pose_base_hole: Pose, distance_m: float) -> Pose:
        """The peg's pose aligned with the hole, its tip that far before the face."""

    def move_to(self, pose_base_peg: Pose, speed_m_s: float = 0.03) -> None:
        """Move on a straight line, near or in the hole."""

    def push(self, pose_base_hole: Pose, force_n: float | None = None) -> bool:
        """Push compliantly along the hole's axis from the present pose; True if the peg went all the way in."""

    def search(self, pose_base_hole: Pose, path: Sequence[PathKnot], *, from_here: bool = False) -> bool:
        """Press lightly and move along a path; True if the peg dropped in. Then use `push`."""

    def touch(self, pose_base_peg_start: Pose, direction_base: Sequence[float]) -> Touch | None:
        """Move from a pose in free air until there is contact, then back a little; None if there was no contact."""

    def withdraw(self, pose_base_hole: Pose, distance_m: float | None = None) -> None:
        """Back along the peg's own axis, until its tip is that far (the stand-off) before the face."""

    def feel(self, duration_s: float = 0.1) -> ContactReading:
        """Hold still; returns the contact wrench on the peg."""

    def estimate(self, prior: PosePrior, touches: Sequence[Touch] | None = None) -> PoseErrorEstimate:
        """The pose of the hole from all touches of this assembly, or from those given, by the cell's estimator."""

    def estimate_by_network(self, touch: Touch, pose_base_hole: Pose) -> PoseErrorEstimate:
        """The pose of the hole from one touch, by the cell's network."""

    def next_touch(self, belief: PosePrior, failed_pushes: int) -> TouchPlan:
        """Plan the next touch."""

    def tell(self, text: str, **figures: float) -> None:
        """Publish a step as text with its numbers, for the terminal, the recording and the report."""

    def give_up(self, reason: str) -> NoReturn:
        """End the assembly as `not_converged`."""


@runtime_checkable
class AssemblyStrategy(Protocol):
    """The protocol of a strategy."""

    def assemble(self, tools: Tools) -> PosePrior:
        """Insert the peg; returns the estimated pose of the hole. Return only with the peg in: planning verifies it."""
