"""Baseline: vision, and one straight push that stops when it feels more than a limit. Nothing yields, nothing mends."""

from __future__ import annotations

from crosspih_common.messages import Failure, PosePrior
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.first_pose import begin
from services.planning.strategies.plain_pushes import straight_push

SPEED_M_S = 0.01
LIMIT_N = 30.0
LIMIT_NM = 3.0


def straight(run: Run) -> PosePrior:
    """A guarded move along the hole's axis, all the way in."""
    belief = begin(run)
    if straight_push(run, belief.pose_base_hole.pose(), SPEED_M_S, LIMIT_N, LIMIT_NM):
        return belief
    raise AssemblyFailed(Failure.NOT_CONVERGED, f"the straight push felt {LIMIT_N:g} N or {LIMIT_NM:g} Nm")
