"""A push that searches on a path while it yields: spirals and tilts."""

from __future__ import annotations

from collections.abc import Callable

from crosspih_common.geometry import Pose
from crosspih_common.keys import ADMITTANCE_MOVE
from crosspih_common.messages import AdmittanceMove, PathKnot, StopReason, floats
from services.planning.leaving import withdraw
from services.planning.run import Run
from services.planning.strategies.clearances import sideways_room_m, tip_depth_m
from services.planning.strategies.plain_pushes import account_push
from services.planning.touching import touch_from

SEARCH_SPEED_M_S = 0.005  # the face is hard
SEARCH_FORCE_N = 8.0
# a wall met on the way stops the search at 10 N; the face's friction only makes its path a little smaller
SEARCH_DAMPING_N_S_M = 1000.0
SEARCH_YIELD_M_S = 0.02
HELD_NM_S_RAD = 1e6  # does not turn by itself
DROP_M = 0.003  # deeper than where it touched by this much: it has found its way
SEARCH_S = 55.0

Path = tuple[PathKnot, ...]


def search_push(
    run: Run, pose_base_hole: Pose, path: Path | Callable[[float], Path], *, from_here: bool = False
) -> bool:
    """Move along a search path under a small force, without turning by itself; whether the peg dropped in.

    It begins aligned with where the hole is believed, after a touch there (that touches nothing: it is in), or from
    where the last push left the peg. The path may depend on how far the peg can move sideways at that depth, m.
    """
    if from_here:
        back_m = run.config.touch_clearance_m
        depth_m = tip_depth_m(run, run.motion.pose_base_peg, pose_base_hole)
        run.motion.slide_to(run.motion.pose_base_peg @ Pose.from_translation([0.0, 0.0, -back_m]))
    else:
        withdraw(run, pose_base_hole, run.config.standoff_m)
        start = run.motion.before_hole(pose_base_hole, run.config.standoff_m)
        touch = touch_from(run, start, pose_base_hole.rotation[:, 2], SEARCH_SPEED_M_S, run.config.touch_threshold_n)
        if touch is None:
            return True
        depth_m = tip_depth_m(run, touch.pose_base_peg.pose(), pose_base_hole)
    outcome = run.ports.ask(
        ADMITTANCE_MOVE,
        AdmittanceMove(
            direction_base=floats(pose_base_hole.rotation[:, 2]),
            speed_m_s=SEARCH_SPEED_M_S,
            travel_m=run.config.touch_clearance_m + DROP_M,
            axial_force_n=SEARCH_FORCE_N,
            lateral_damping_n_s_m=SEARCH_DAMPING_N_S_M,
            lateral_speed_limit_m_s=SEARCH_YIELD_M_S,
            rotational_damping_nm_s_rad=HELD_NM_S_RAD,
            centre_peg_m=(0.0, 0.0, run.workcell.peg.shape().tip_m - max(depth_m, 0.0)),
            timeout_s=SEARCH_S,
            path=path(sideways_room_m(run.workcell, depth_m)) if callable(path) else path,
        ),
    )
    return account_push(run, outcome, outcome.stop_reason is StopReason.SEATED)
