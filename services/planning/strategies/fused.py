"""6-DoF vision, compliant push, and touches fused by the estimator where that does not enter."""

from __future__ import annotations

import numpy as np

from crosspih_common.keys import ESTIMATE, NEXT_TOUCH
from crosspih_common.messages import (
    EstimatePose,
    Failure,
    LocateMethod,
    NextTouch,
    PosePrior,
)
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.steps import correct, locate, tell_estimate


def fused(run: Run) -> PosePrior:
    """6-DoF vision, compliant push; where that does not enter: touch, fuse all touches, correct, push again."""
    seen = locate(run, LocateMethod.RIM)
    prior = PosePrior(pose_base_hole=seen.pose_base_hole, covariance=seen.covariance)
    belief = prior
    explained = True
    run.approach(seen.pose_base_hole.pose())
    for attempt in range(run.config.max_attempts):
        run.attempt = attempt
        if run.push(belief.pose_base_hole.pose()):
            return belief
        run.withdraw(belief.pose_base_hole.pose(), run.config.standoff_m)
        plan = run.ports.ask(
            NEXT_TOUCH,
            NextTouch(
                belief=belief,
                touches_made=len(run.touches),
                failed_pushes=attempt + 1,
                last_touch_used=explained,
            ),
        )
        touch = run.touch(
            plan.pose_base_peg_start.pose(),
            np.asarray(plan.direction_base),
            run.config.touch_speed_m_s,
            run.config.touch_threshold_n,
        )
        if touch is None:
            continue
        run.withdraw(belief.pose_base_hole.pose(), run.config.standoff_m)
        estimate = run.ports.ask(ESTIMATE, EstimatePose(prior=prior, touches=tuple(run.touches)))
        tell_estimate(run, estimate)
        explained = estimate.rests_on[-1].used
        if not any(use.used for use in estimate.rests_on) or not run.can_be(estimate.pose_base_hole.pose()):
            # nothing explains what was felt: no correction, and the next touch is another arm's
            continue
        belief = PosePrior(pose_base_hole=estimate.pose_base_hole, covariance=estimate.covariance)
        correct(run, estimate.pose_base_hole.pose())
    raise AssemblyFailed(Failure.NOT_CONVERGED, f"{run.config.max_attempts} pushes did not enter")
