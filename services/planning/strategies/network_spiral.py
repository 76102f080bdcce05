"""Baseline: the paper's network with 6-DoF vision before it and a spiral behind it.

One wrench, the network's correction, as in `paper`; where the push after a correction does not enter either, a spiral
and one more push before the next contact.
"""

from __future__ import annotations

from crosspih_common.keys import NETWORK
from crosspih_common.messages import EstimateByNetwork, Failure, PoseData, PosePrior
from services.planning.leaving import withdraw
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.correcting import correct, report_estimate
from services.planning.strategies.first_pose import begin
from services.planning.strategies.spiral import enter_by_spiral, radius_of
from services.planning.touching import touch_from

PUSHES_A_CORRECTION = 2


def network_spiral(run: Run) -> PosePrior:
    """Push; contact, network, correct; push, spiral, push; and again from the corrected belief."""
    seen = begin(run)
    belief, radius_m = seen.pose_base_hole.pose(), radius_of(run, seen)
    for attempt in range(run.config.max_attempts):
        run.counts.attempt = attempt
        if enter_by_spiral(run, belief, radius_m, 1 if attempt == 0 else PUSHES_A_CORRECTION):
            return PosePrior(pose_base_hole=PoseData.of(belief), covariance=seen.covariance)
        withdraw(run, belief, run.config.standoff_m)
        touch = touch_from(
            run,
            run.motion.before_hole(belief, run.config.standoff_m),
            belief.rotation[:, 2],
            run.config.paper_speed_m_s,
            run.config.paper_threshold_n,
        )
        if touch is None:
            continue
        withdraw(run, belief, run.config.standoff_m)
        estimate = run.ports.ask(NETWORK, EstimateByNetwork(touch=touch, pose_base_hole_believed=PoseData.of(belief)))
        report_estimate(run, estimate)
        corrected = estimate.pose_base_hole.pose()
        # a correction that leaves where the hole can be is dropped: the search starts over where vision saw it
        belief = corrected if run.hole.is_plausible_hole_pose(corrected) else seen.pose_base_hole.pose()
        correct(run, belief)
    raise AssemblyFailed(Failure.NOT_CONVERGED, f"{run.config.max_attempts} contacts and spirals did not lead in")
