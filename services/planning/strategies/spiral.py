"""Baseline: compliant push, and an Archimedean spiral where that does not enter (Chhatpar and Branicky 2001).

The tip is pressed lightly and moved along a spiral until it drops; from there the push is tried again. The pitch is
what the tip has of free play where it touches, so that no place inside the spiral is passed by.
"""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.messages import Failure, PathKnot, PosePrior
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.first_pose import begin
from services.planning.strategies.search_push import SEARCH_S, search_push
from services.planning.touching import push

SPEED_M_S = 0.008
SETTLE_S = 0.5  # to come back into contact before the path begins
STEP_RAD = 0.25
MIN_STEP_S = 0.001  # of the arm
PUSHES = 5  # with a spiral between each two
SDS = 3.0  # of the belief's lateral spread


def spiral(run: Run) -> PosePrior:
    """Push; spiral until the tip drops; push."""
    belief = begin(run)
    if not enter_by_spiral(run, belief.pose_base_hole.pose(), radius_of(run, belief), PUSHES):
        raise AssemblyFailed(Failure.NOT_CONVERGED, f"{PUSHES} pushes and spirals did not enter")
    return belief


def enter_by_spiral(run: Run, pose_base_hole: Pose, radius_m: float, pushes: int) -> bool:
    """Pushes with a spiral between each two; whether the peg is in.

    The first spiral begins where the hole is believed, the second where the push after it ended (a tip that dropped in
    off the hole's middle is nearer then), and the next two again, finer and the other way round.
    """
    aim = pose_base_hole
    for attempt in range(pushes):
        if push(run, aim):
            return True
        if attempt == pushes - 1:
            break

        def path(room_m: float, attempt: int = attempt) -> tuple[PathKnot, ...]:
            return archimedean(radius_m, room_m / (1 + attempt // 2), SPEED_M_S, clockwise=attempt // 2 == 1)

        search_push(run, aim, path, from_here=attempt % 2 == 1)
    return False


def radius_of(run: Run, belief: PosePrior) -> float:
    """How far from the believed place the hole may be, m: never farther than the drawing says."""
    sd_m = float(np.sqrt(np.max(np.diag(np.asarray(belief.covariance).reshape(6, 6))[:2])))
    return min(SDS * sd_m, float(np.hypot(*run.workcell.hole_prior.half_ranges()[:2])))


def archimedean(radius_m: float, pitch_m: float, speed_m_s: float, clockwise: bool = False) -> tuple[PathKnot, ...]:
    """A spiral r = pitch * angle / 2 pi out to a radius, at a constant speed; faster where it would take too long."""
    a = pitch_m / (2.0 * np.pi)
    angles = np.arange(STEP_RAD, max(radius_m / a, 2.0 * np.pi) + STEP_RAD, STEP_RAD)
    lengths = 0.5 * a * (angles * np.sqrt(1.0 + angles**2) + np.arcsinh(angles))
    times = SETTLE_S + lengths / max(speed_m_s, float(lengths[-1]) / (SEARCH_S - SETTLE_S))
    sense = -1.0 if clockwise else 1.0
    knots = [PathKnot(time_s=SETTLE_S)]
    for angle, time_s in zip(angles.tolist(), times.tolist(), strict=True):
        # of a fine spiral's innermost turns a chord is enough
        if time_s - knots[-1].time_s >= MIN_STEP_S:
            offset = (a * angle * np.cos(angle), sense * a * angle * np.sin(angle), 0.0)
            knots.append(PathKnot(time_s=time_s, offset_m=offset))
    return tuple(knots)
