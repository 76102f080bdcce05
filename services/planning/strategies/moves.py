"""The moves of the baselines: a straight push, a push by position alone, and a push that searches while it yields."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import ADMITTANCE_MOVE, GUARDED_MOVE
from crosspih_common.messages import (
    AdmittanceMove,
    GuardedMove,
    MotionOutcome,
    PathKnot,
    Phase,
    StopReason,
    floats,
)
from services.planning.leaving import withdraw
from services.planning.run import Run
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


def way_in_m(run: Run, pose_base_hole: Pose) -> float:
    """How far the tip has to go along the hole's axis until the peg is seated, m."""
    shape = run.workcell.peg.shape()
    chamfer_m = run.workcell.hole.shape(shape).chamfer_m
    seated_m = chamfer_m + shape.taper_length_m + run.workcell.insertion_depth_m + run.config.extra_depth_m
    return seated_m - tip_depth_m(run, run.pose_base_peg, pose_base_hole)


def tip_depth_m(run: Run, pose_base_peg: Pose, pose_base_hole: Pose) -> float:
    """How far the tip is behind the hole's face, m."""
    tip = pose_base_peg.apply([0.0, 0.0, run.workcell.peg.shape().tip_m])
    return float(pose_base_hole.inverse().apply(tip)[2])


def room_m(workcell: Workcell, tip_depth: float) -> float:
    """How far an aligned peg can move sideways, either way, with its tip that deep in the hole, m.

    On the face, and before it, this is what the tip has: the lateral error from which it drops in.
    """
    peg = workcell.peg.shape()
    hole = workcell.hole.shape(peg)
    at_rim_m = peg.tip_m - max(tip_depth - hole.chamfer_m, 0.0)
    bore, section = _edge_distances_m(hole.inner_rim_m()), _edge_distances_m(peg.outline_m(at_rim_m))
    return float(np.min(bore - section))


def _edge_distances_m(corners_m: Array) -> Array:
    """How far the line of each edge of an outline (n, 3) is from its centre, (n,), m."""
    first = corners_m[:, :2]
    along = np.roll(first, -1, axis=0) - first
    return np.asarray(np.abs(first[:, 0] * along[:, 1] - first[:, 1] * along[:, 0]) / np.linalg.norm(along, axis=1))


def straight_push(run: Run, pose_base_hole: Pose, speed_m_s: float, limit_n: float, limit_nm: float) -> bool:
    """Straight in, without yielding, until seated or until more than a limit is felt; whether it went all the way."""
    run.pushes += 1
    run.tell(Phase.PUSHING, f"straight push {run.pushes}")
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
    return _told(run, outcome, outcome.stop_reason is StopReason.TRAVEL_LIMIT)


def position_push(run: Run, pose_base_hole: Pose, speed_m_s: float) -> bool:
    """In by position alone: only the cell's caps stop it; whether it went all the way."""
    run.pushes += 1
    run.tell(Phase.PUSHING, "insertion by position")
    seated = run.pose_base_peg.translation_m + pose_base_hole.rotation[:, 2] * way_in_m(run, pose_base_hole)
    overloads = run.overloads
    run.slide_to(Pose(run.pose_base_peg.rotation, seated), speed_m_s)
    return run.overloads == overloads


def search_push(
    run: Run, pose_base_hole: Pose, path: Path | Callable[[float], Path], *, from_here: bool = False
) -> bool:
    """Move along a search path under a small force, without turning by itself; whether the peg dropped in.

    It begins aligned with where the hole is believed, after a touch there (that touches nothing: it is in), or from
    where the last push left the peg. The path may depend on how far the peg can move sideways at that depth, m.
    """
    if from_here:
        back_m = run.config.touch_clearance_m
        depth_m = tip_depth_m(run, run.pose_base_peg, pose_base_hole)
        run.slide_to(run.pose_base_peg @ Pose.from_translation([0.0, 0.0, -back_m]))
    else:
        withdraw(run, pose_base_hole, run.config.standoff_m)
        start = run.before_hole(pose_base_hole, run.config.standoff_m)
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
            path=path(room_m(run.workcell, depth_m)) if callable(path) else path,
        ),
    )
    return _told(run, outcome, outcome.stop_reason is StopReason.SEATED)


def _told(run: Run, outcome: MotionOutcome, done: bool) -> bool:
    run.account(outcome)
    run.tell(
        Phase.SEATED if done else Phase.PUSHING,
        f"{'done' if done else 'not in'}: {outcome.stop_reason.value} after {outcome.travel_m * 1e3:.1f} mm",
        travel_mm=outcome.travel_m * 1e3,
        peak_force_n=outcome.peak_force_n,
        peak_moment_nm=outcome.peak_moment_nm,
    )
    return done
