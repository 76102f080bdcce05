"""The strategies by name: what to do between seeing the hole and sitting in it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.keys import ESTIMATE, LOCATE, NETWORK, NEXT_TOUCH
from crosspih_common.messages import (
    EstimateByNetwork,
    EstimatePose,
    Failure,
    HoleEstimate,
    LocateHole,
    LocateMethod,
    NextTouch,
    Phase,
    PoseData,
    PoseErrorEstimate,
    PosePrior,
    Strategy,
)
from services.planning.ports import AssemblyFailed
from services.planning.run import Run

LOOKS = 2  # pictures taken before vision's refusal is believed


def locate(run: Run, method: LocateMethod) -> HoleEstimate:
    """Ask vision, again with a new picture when it refuses."""
    run.tell(Phase.LOCATING, f"looking for the hole ({method.value})")
    refusal: CommandRefused | None = None
    for _ in range(LOOKS):
        try:
            seen = run.ports.ask(LOCATE, LocateHole(method=method))
        except CommandRefused as error:
            refusal = error
            run.tell(Phase.LOCATING, f"vision refused: {error}")
            continue
        sd = np.sqrt(np.diag(np.asarray(seen.covariance).reshape(6, 6)))
        x, y, z = seen.pose_base_hole.position_m
        run.tell(
            Phase.LOCATING,
            f"hole at ({x * 1e3:.1f}, {y * 1e3:.1f}, {z * 1e3:.1f}) mm",
            sd_lateral_mm=float(np.hypot(sd[0], sd[1])) * 1e3,
            sd_depth_mm=float(sd[2]) * 1e3,
            sd_tilt_deg=float(np.rad2deg(np.hypot(sd[3], sd[4]))),
        )
        run.vision_pose = run.believed = seen.pose_base_hole.pose()
        return seen
    raise AssemblyFailed(Failure.NOT_SEEN, str(refusal))


def _tell_estimate(run: Run, estimate: PoseErrorEstimate) -> None:
    alpha, beta, gamma = np.rad2deg(estimate.angles_rad)
    x, y, _ = np.asarray(estimate.translation_m) * 1e3
    run.tell(
        Phase.ESTIMATING,
        f"peg is off by ({alpha:.2f}, {beta:.2f}, {gamma:.2f}) deg, ({x:.2f}, {y:.2f}) mm; "
        f"{estimate.method}, rank {estimate.rank}",
        alpha_deg=alpha,
        beta_deg=beta,
        gamma_deg=gamma,
        x_mm=x,
        y_mm=y,
        rank=estimate.rank,
        friction=estimate.friction,
        residual_cost=estimate.residual_cost,
    )


def _correct(run: Run, pose_base_hole: Pose) -> None:
    run.corrections += 1
    run.believed = pose_base_hole
    run.tell(Phase.CORRECTING, f"correction {run.corrections}")
    run.slide_to(run.before_hole(pose_base_hole, run.config.standoff_m))


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
        _tell_estimate(run, estimate)
        explained = estimate.rests_on[-1].used
        if not any(use.used for use in estimate.rests_on) or not run.can_be(estimate.pose_base_hole.pose()):
            # nothing explains what was felt: no correction, and the next touch is another arm's
            continue
        belief = PosePrior(pose_base_hole=estimate.pose_base_hole, covariance=estimate.covariance)
        _correct(run, estimate.pose_base_hole.pose())
    raise AssemblyFailed(Failure.NOT_CONVERGED, f"{run.config.max_attempts} pushes did not enter")


def paper(run: Run) -> PosePrior:
    """The published loop: position-only vision, straight push; one wrench -> network -> correct, and again."""
    seen = locate(run, LocateMethod.PAPER)
    belief = seen.pose_base_hole.pose()
    run.approach(belief)
    for attempt in range(run.config.paper_attempts):
        run.attempt = attempt
        run.pushes += 1
        touch = run.touch(
            run.before_hole(belief, run.config.standoff_m),
            belief.rotation[:, 2],
            run.config.paper_speed_m_s,
            run.config.paper_threshold_n,
        )
        if touch is None and run.push(belief):
            # nothing was felt all along the taper: the body is at its bore, and the rest is the slide-in
            return PosePrior(pose_base_hole=PoseData.of(belief), covariance=seen.covariance)
        if touch is None:
            run.slide_to(run.before_hole(belief, run.config.standoff_m))
            continue
        estimate = run.ports.ask(NETWORK, EstimateByNetwork(touch=touch, pose_base_hole_believed=PoseData.of(belief)))
        _tell_estimate(run, estimate)
        belief = estimate.pose_base_hole.pose()
        if not run.can_be(belief):
            raise AssemblyFailed(Failure.NOT_CONVERGED, "the network's correction leaves where the hole can be")
        run.slide_to(run.pose_base_peg @ Pose.from_translation([0.0, 0.0, -0.03]))
        _correct(run, belief)
    raise AssemblyFailed(Failure.NOT_CONVERGED, f"{run.config.paper_attempts} contacts did not lead in")


STRATEGIES: dict[Strategy, Callable[[Run], PosePrior]] = {Strategy.FUSED: fused, Strategy.PAPER: paper}
