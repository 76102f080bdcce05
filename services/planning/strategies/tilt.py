"""Baseline: compliant push, and random tilts about the rim under a light force where that does not enter.

As a person wiggles a key: the peg is turned about the point where it stands in the rim, to random rotations inside what
vision may be off, until it drops; from there the push is tried again.
"""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Failure, PathKnot, PosePrior
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.first_pose import begin
from services.planning.strategies.search_push import search_push
from services.planning.touching import push

SPEED_RAD_S = 0.2
SETTLE_S = 0.5
TILTS = 20
SDS = 2.0
SEED = 2
PUSHES = 5  # with a search between each two: what did not help four times will not the fifth


def tilt(run: Run) -> PosePrior:
    """Push; tilt about until it drops; push."""
    belief = begin(run)
    pose = belief.pose_base_hole.pose()
    sd_rad = np.sqrt(np.diag(np.asarray(belief.covariance).reshape(6, 6))[3:])
    reach_rad = np.minimum(SDS * sd_rad, run.workcell.hole_prior.half_ranges()[3:])
    for attempt in range(PUSHES):
        run.counts.attempt = attempt
        if push(run, pose):
            return belief
        knots = random_tilts(np.random.default_rng([SEED, attempt]), reach_rad)
        search_push(run, pose, knots, from_here=attempt % 2 == 1)
    raise AssemblyFailed(Failure.NOT_CONVERGED, f"{PUSHES} pushes and tilts did not enter")


def random_tilts(rng: np.random.Generator, reach_rad: Array) -> tuple[PathKnot, ...]:
    """Rotations uniform within (3,) rad about x, y, z, one after the other at a constant speed."""
    turns = rng.uniform(-reach_rad, reach_rad, (TILTS, 3))
    ways = np.linalg.norm(np.diff(np.vstack([np.zeros(3), turns]), axis=0), axis=1)
    times = SETTLE_S + np.cumsum(np.maximum(ways / SPEED_RAD_S, 0.02))
    return (
        PathKnot(time_s=SETTLE_S),
        *(
            PathKnot(time_s=time_s, turn_rad=(x, y, z))
            for time_s, (x, y, z) in zip(times.tolist(), turns.tolist(), strict=True)
        ),
    )
