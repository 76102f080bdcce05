"""Baseline: touches through a recurrent network to the pose, everything else as in `fused`."""

from __future__ import annotations

import numpy as np

from crosspih_common.keys import NEXT_TOUCH, SEQUENCE_NETWORK
from crosspih_common.messages import EstimateBySequence, Failure, NextTouch, PosePrior
from services.planning.leaving import withdraw
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.correcting import correct, report_estimate
from services.planning.strategies.first_pose import begin
from services.planning.touching import push, touch_from


def sequence(run: Run) -> PosePrior:
    """Push; where that does not enter: touch, all touches so far through the network, correct, push again."""
    prior = belief = begin(run)
    for attempt in range(run.config.max_attempts):
        run.counts.attempt = attempt
        pose = belief.pose_base_hole.pose()
        if push(run, pose):
            return belief
        withdraw(run, pose, run.config.standoff_m)
        plan = run.ports.ask(
            NEXT_TOUCH, NextTouch(belief=belief, touches_made=len(run.touches), failed_pushes=attempt + 1)
        )
        touch = touch_from(
            run,
            plan.pose_base_peg_start.pose(),
            np.asarray(plan.direction_base),
            run.config.touch_speed_m_s,
            run.config.touch_threshold_n,
        )
        if touch is None:
            continue
        withdraw(run, pose, run.config.standoff_m)
        estimate = run.ports.ask(SEQUENCE_NETWORK, EstimateBySequence(prior=prior, touches=tuple(run.touches)))
        report_estimate(run, estimate)
        if not run.hole.is_plausible_hole_pose(estimate.pose_base_hole.pose()):
            continue
        belief = PosePrior(pose_base_hole=estimate.pose_base_hole, covariance=estimate.covariance)
        correct(run, estimate.pose_base_hole.pose())
    raise AssemblyFailed(Failure.NOT_CONVERGED, f"{run.config.max_attempts} pushes did not enter")
