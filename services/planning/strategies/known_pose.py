"""The paper's second half: the pose between the platforms is known from an assembly with another peg, so this peg is
driven to before its hole and pushed in, yielding. No vision, no touch."""

from __future__ import annotations

from crosspih_common.messages import Failure, PosePrior
from services.planning.leaving import withdraw
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.touching import push


def known_pose(run: Run) -> PosePrior:
    """To before the hole that the request tells of, and a compliant push."""
    if run.hole.known is None:
        raise AssemblyFailed(Failure.REFUSED, "known_pose: the request tells no pose; put `known` into it")
    pose = run.hole.known.pose_base_hole.pose()
    if not run.hole.is_plausible_hole_pose(pose):
        raise AssemblyFailed(Failure.REFUSED, "known_pose: the hole cannot be where the request says")
    run.hole.believed = pose
    run.motion.approach(pose)
    for attempt in range(run.config.max_attempts):
        run.counts.attempt = attempt
        if push(run, pose):
            return run.hole.known
        withdraw(run, pose, run.config.standoff_m)
    raise AssemblyFailed(Failure.NOT_CONVERGED, f"{run.config.max_attempts} pushes at the known pose did not enter")
