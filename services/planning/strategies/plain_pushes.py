"""Pushes that neither yield nor search: straight until a limit is felt, and by position alone."""

from __future__ import annotations

from crosspih_common.geometry import Pose
from crosspih_common.keys import GUARDED_MOVE
from crosspih_common.messages import GuardedMove, MotionOutcome, Phase, StopReason, floats
from services.planning.run import Run
from services.planning.strategies.clearances import way_in_m


def straight_push(run: Run, pose_base_hole: Pose, speed_m_s: float, limit_n: float, limit_nm: float) -> bool:
    """Straight in, without yielding, until seated or until more than a limit is felt; whether it went all the way."""
    run.counts.pushes += 1
    run.tell(Phase.PUSHING, f"straight push {run.counts.pushes}")
    outcome = run.ports.ask(
        GUARDED_MOVE,
        GuardedMove(
            direction_base=floats(pose_base_hole.rotation[:, 2]),
            speed_m_s=speed_m_s,
            force_threshold_n=limit_n,
            moment_threshold_nm=limit_nm,
            travel_limit_m=way_in_m(run, pose_base_hole),
        ),
    )
    return account_push(run, outcome, outcome.stop_reason is StopReason.TRAVEL_LIMIT)


def position_push(run: Run, pose_base_hole: Pose, speed_m_s: float) -> bool:
    """In by position alone: only the cell's caps stop it; whether it went all the way."""
    run.counts.pushes += 1
    run.tell(Phase.PUSHING, "insertion by position")
    seated = run.motion.pose_base_peg.translation_m + pose_base_hole.rotation[:, 2] * way_in_m(run, pose_base_hole)
    overloads = run.counts.overloads
    run.motion.slide_to(Pose(run.motion.pose_base_peg.rotation, seated), speed_m_s)
    return run.counts.overloads == overloads


def account_push(run: Run, outcome: MotionOutcome, done: bool) -> bool:
    """Count a push and tell how it ended; `done` again."""
    run.motion.account(outcome)
    run.tell(
        Phase.SEATED if done else Phase.PUSHING,
        f"{'done' if done else 'not in'}: {outcome.stop_reason.value} after {outcome.travel_m * 1e3:.1f} mm",
        travel_mm=outcome.travel_m * 1e3,
        peak_force_n=outcome.peak_force_n,
        peak_moment_nm=outcome.peak_moment_nm,
    )
    return done
