"""6-DoF vision, compliant push, and touches fused by the estimator where that does not enter."""

from __future__ import annotations

import numpy as np

from crosspih_common.keys import ESTIMATE, NEXT_TOUCH
from crosspih_common.messages import (
    EstimatePose,
    Failure,
    LocateMethod,
    NextTouch,
    Phase,
    PosePrior,
)
from services.planning.leaving import withdraw
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.advised_push import push_in
from services.planning.strategies.correcting import correct, report_estimate
from services.planning.strategies.force_alone import force_alone
from services.planning.strategies.locating import locate
from services.planning.touching import touch_from


def fused(run: Run) -> PosePrior:
    """6-DoF vision, compliant push; where that does not enter: touch, fuse all touches, correct, push again."""
    try:
        seen = locate(run, LocateMethod.RIM)
    except AssemblyFailed as unseen:
        if unseen.failure is not Failure.NOT_SEEN or not run.config.feel_when_unseen:
            raise
        run.hole.felt_for = True
        return force_alone(run)
    prior = PosePrior(pose_base_hole=seen.pose_base_hole, covariance=seen.covariance)
    belief = prior
    explained = True
    run.motion.approach(seen.pose_base_hole.pose())
    for attempt in range(run.config.max_attempts):
        run.counts.attempt = attempt
        seated = push_in(run, belief)
        if seated is not None:
            return seated
        withdraw(run, belief.pose_base_hole.pose(), run.config.standoff_m)
        plan = run.ports.ask(
            NEXT_TOUCH,
            NextTouch(
                belief=belief,
                touches_made=len(run.touches),
                failed_pushes=attempt + 1,
                last_touch_used=explained,
            ),
        )
        touch = touch_from(
            run,
            plan.pose_base_peg_start.pose(),
            np.asarray(plan.direction_base),
            run.config.touch_speed_m_s,
            run.config.touch_threshold_n,
            slow_travel_m=2.0 * run.config.standoff_m,
        )
        if touch is None:
            continue
        withdraw(run, belief.pose_base_hole.pose(), run.config.standoff_m)
        estimate = run.ports.ask(ESTIMATE, EstimatePose(prior=prior, touches=tuple(run.touches)))
        report_estimate(run, estimate)
        explained = estimate.rests_on[-1].used
        if not any(use.used for use in estimate.rests_on) or not run.hole.is_plausible_hole_pose(
            estimate.pose_base_hole.pose()
        ):
            # nothing explains what was felt: no correction, and the next touch is another arm's
            continue
        belief = PosePrior(pose_base_hole=estimate.pose_base_hole, covariance=estimate.covariance)
        correct(run, estimate.pose_base_hole.pose())
    if not run.config.feel_when_unseen:
        raise AssemblyFailed(Failure.NOT_CONVERGED, f"{run.config.max_attempts} pushes did not enter")
    run.hole.felt_for = True
    run.tell(Phase.TOUCHING, "what vision saw does not lead in: it is forgotten")
    withdraw(run, run.workcell.hole_prior.pose_base_hole(), run.config.approach_m)
    return force_alone(run)
