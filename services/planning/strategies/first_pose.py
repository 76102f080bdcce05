"""Where a strategy begins: what vision sees, or the drawing and three touches of the face where it sees nothing."""

from __future__ import annotations

from crosspih_common.messages import Failure, LocateMethod, PosePrior
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.face_touches import pose_by_face_touches
from services.planning.strategies.locating import locate


def begin(run: Run, method: LocateMethod = LocateMethod.RIM) -> PosePrior:
    """The hole as first believed, and the peg at its stand-off before it."""
    try:
        seen = locate(run, method)
    except AssemblyFailed as failed:
        if failed.failure is not Failure.NOT_SEEN:
            raise
        run.hole.felt_for = True
        return pose_by_face_touches(run)
    run.motion.approach(seen.pose_base_hole.pose())
    return PosePrior(pose_base_hole=seen.pose_base_hole, covariance=seen.covariance)
