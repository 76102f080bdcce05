"""A push that heeds advice where the peg stalls in its bore."""

from __future__ import annotations

from crosspih_common.geometry import Pose
from crosspih_common.keys import ADVISE_INSERTION
from crosspih_common.messages import AdviseInsertion, BoreContact, InsertionAction, Phase, PosePrior
from services.planning.run import Run
from services.planning.touching import feel, push


def push_in(run: Run, belief: PosePrior) -> PosePrior | None:
    """Push along the believed axis; the belief with which the peg went in, None where it did not enter its bore.

    A peg that stalls with its body in the bore is jammed or wedged: it backs off and is aligned, or is pushed with
    another force, as the inference service advises from what it feels.
    """
    force_n = run.config.push_force_n
    if push(run, belief.pose_base_hole.pose(), force_n):
        return belief
    for _ in range(run.config.max_advices):
        outcome, reading = feel(run)
        advice = run.ports.ask(
            ADVISE_INSERTION,
            AdviseInsertion(
                belief=belief,
                pose_base_peg=outcome.pose_base_peg,
                joints_rad=outcome.joints_rad,
                wrench=reading.wrench,
                push_force_n=force_n,
            ),
        )
        if advice.contact is BoreContact.OUTSIDE:
            return None
        run.tell(
            Phase.PUSHING,
            f"{advice.contact.value}: {advice.reason}; {advice.action.value}",
            entered_mm=advice.entered_m * 1e3,
            push_force_n=advice.push_force_n,
            back_off_mm=advice.back_off_m * 1e3,
        )
        belief = PosePrior(pose_base_hole=advice.pose_base_hole, covariance=advice.covariance)
        if advice.action is InsertionAction.BACK_OFF:
            # straight out before it is turned: what is turned while it is clamped presses harder
            out = Pose.from_translation([0.0, 0.0, -advice.back_off_m])
            run.motion.slide_to(run.motion.pose_base_peg @ out, run.config.press_speed_m_s)
        if advice.action is not InsertionAction.LOWER_PUSH:
            # aligned; where it should slide and yet stood, at the depth where it is
            run.motion.slide_to(advice.pose_base_peg.pose(), run.config.press_speed_m_s)
        force_n = advice.push_force_n
        if advice.action is InsertionAction.CONTINUE:
            # a push that was lowered and stood was too weak: what is felt at rest speaks for none so weak
            force_n = max(force_n, run.config.push_force_n)
        if push(run, belief.pose_base_hole.pose(), force_n):
            return belief
    return None
