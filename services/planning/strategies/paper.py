"""The published loop: position-only vision, one wrench through the network to a correction."""

from __future__ import annotations

from crosspih_common.geometry import Pose
from crosspih_common.keys import NETWORK
from crosspih_common.messages import (
    EstimateByNetwork,
    Failure,
    LocateMethod,
    PoseData,
    PosePrior,
)
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.correcting import correct, report_estimate
from services.planning.strategies.first_pose import begin
from services.planning.touching import push, touch_from


def paper(run: Run) -> PosePrior:
    """The published loop: position-only vision, straight push; one wrench -> network -> correct, and again."""
    seen = begin(run, LocateMethod.PAPER)
    belief = seen.pose_base_hole.pose()
    for attempt in range(run.config.paper_attempts):
        run.counts.attempt = attempt
        run.counts.pushes += 1
        touch = touch_from(
            run,
            run.motion.before_hole(belief, run.config.standoff_m),
            belief.rotation[:, 2],
            run.config.paper_speed_m_s,
            run.config.paper_threshold_n,
        )
        if touch is None and push(run, belief):
            # nothing was felt all along the taper: the body is at its bore, and the rest is the slide-in
            return PosePrior(pose_base_hole=PoseData.of(belief), covariance=seen.covariance)
        if touch is None:
            run.motion.slide_to(run.motion.before_hole(belief, run.config.standoff_m))
            continue
        estimate = run.ports.ask(NETWORK, EstimateByNetwork(touch=touch, pose_base_hole_believed=PoseData.of(belief)))
        report_estimate(run, estimate)
        belief = estimate.pose_base_hole.pose()
        if not run.hole.is_plausible_hole_pose(belief):
            raise AssemblyFailed(Failure.NOT_CONVERGED, "the network's correction leaves where the hole can be")
        run.motion.slide_to(run.motion.pose_base_peg @ Pose.from_translation([0.0, 0.0, -0.03]))
        correct(run, belief)
    raise AssemblyFailed(Failure.NOT_CONVERGED, f"{run.config.paper_attempts} contacts did not lead in")
