"""Baseline: vision and compliant pushes alone. After a push that did not enter, the peg comes back to where vision saw
the hole, off by what vision may be off, and pushes again: a restart, for the same push would end the same way."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.messages import Failure, PosePrior
from services.planning.leaving import withdraw
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.first_pose import begin
from services.planning.touching import push

SEED = 1


def admittance(run: Run) -> PosePrior:
    """Push; come back; push from a pose drawn from the belief."""
    belief = begin(run)
    seen = belief.pose_base_hole.pose()
    spread = np.linalg.cholesky(np.asarray(belief.covariance).reshape(6, 6))
    rng = np.random.default_rng(SEED)
    aim = seen
    for attempt in range(run.config.max_attempts):
        run.counts.attempt = attempt
        if push(run, aim):
            return belief
        withdraw(run, seen, run.config.standoff_m)
        off = spread @ np.clip(rng.normal(size=6), -2.0, 2.0)
        aim = seen @ Pose.from_rotvec(off[3:], [off[0], off[1], 0.0])
        run.motion.slide_to(run.motion.before_hole(aim, run.config.standoff_m))
    raise AssemblyFailed(Failure.NOT_CONVERGED, f"{run.config.max_attempts} compliant pushes did not enter")
