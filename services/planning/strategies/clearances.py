"""How deep the peg is in the hole, how far it still has to go, and how far it can move sideways there."""

from __future__ import annotations

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.planning.run import Run


def way_in_m(run: Run, pose_base_hole: Pose) -> float:
    """How far the tip has to go along the hole's axis until the peg is seated, m."""
    shape = run.workcell.peg.shape()
    chamfer_m = run.workcell.hole.shape(shape).chamfer_m
    seated_m = chamfer_m + shape.taper_length_m + run.workcell.insertion_depth_m + run.config.extra_depth_m
    return seated_m - tip_depth_m(run, run.motion.pose_base_peg, pose_base_hole)


def tip_depth_m(run: Run, pose_base_peg: Pose, pose_base_hole: Pose) -> float:
    """How far the tip is behind the hole's face, m."""
    tip = pose_base_peg.apply([0.0, 0.0, run.workcell.peg.shape().tip_m])
    return float(pose_base_hole.inverse().apply(tip)[2])


def sideways_room_m(workcell: Workcell, tip_depth: float) -> float:
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
