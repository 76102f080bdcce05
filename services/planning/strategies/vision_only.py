"""Baseline: vision and a position-controlled insertion. Force is not looked at; only the cell's caps end it."""

from __future__ import annotations

from crosspih_common.messages import Failure, PosePrior
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.first_pose import begin
from services.planning.strategies.plain_pushes import position_push

SPEED_M_S = 0.015


def vision_only(run: Run) -> PosePrior:
    """One linear move to the seated pose."""
    belief = begin(run)
    if position_push(run, belief.pose_base_hole.pose(), SPEED_M_S):
        return belief
    raise AssemblyFailed(Failure.OVERLOAD, "the cell's caps stopped the insertion by position")
