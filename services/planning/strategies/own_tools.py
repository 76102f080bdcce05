"""What a strategy of somebody's own is given: the moves that ours are made of (crosspih_common/strategy.py)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.keys import ESTIMATE, NETWORK, NEXT_TOUCH
from crosspih_common.messages import (
    ContactReading,
    EstimateByNetwork,
    EstimatePose,
    Failure,
    HoleEstimate,
    LocateMethod,
    NextTouch,
    PathKnot,
    Phase,
    PoseData,
    PoseErrorEstimate,
    PosePrior,
    Touch,
    TouchPlan,
)
from services.planning.leaving import withdraw
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies.correcting import report_estimate
from services.planning.strategies.locating import locate
from services.planning.strategies.search_push import search_push
from services.planning.touching import feel, push, touch_from


class RunTools:
    """Implements Tools by a run."""

    def __init__(self, run: Run) -> None:
        self._run = run

    @property
    def workcell(self) -> Workcell:
        """See Tools."""
        return self._run.workcell

    @property
    def pose_base_peg(self) -> Pose:
        """See Tools."""
        return self._run.motion.pose_base_peg

    @property
    def touches(self) -> tuple[Touch, ...]:
        """See Tools."""
        return tuple(self._run.touches)

    def locate(self) -> HoleEstimate:
        """See Tools."""
        return locate(self._run, LocateMethod.RIM)

    def approach(self, pose_base_hole: Pose) -> None:
        """See Tools."""
        self._believe(pose_base_hole)
        self._run.motion.approach(pose_base_hole)

    def before_hole(self, pose_base_hole: Pose, distance_m: float) -> Pose:
        """See Tools."""
        return self._run.motion.before_hole(pose_base_hole, distance_m)

    def move_to(self, pose_base_peg: Pose, speed_m_s: float = 0.03) -> None:
        """See Tools."""
        self._run.motion.slide_to(pose_base_peg, speed_m_s)

    def push(self, pose_base_hole: Pose, force_n: float | None = None) -> bool:
        """See Tools."""
        self._believe(pose_base_hole)
        self._run.counts.attempt = self._run.counts.pushes
        return push(self._run, pose_base_hole, force_n)

    def search(self, pose_base_hole: Pose, path: Sequence[PathKnot], *, from_here: bool = False) -> bool:
        """See Tools."""
        self._believe(pose_base_hole)
        return search_push(self._run, pose_base_hole, tuple(path), from_here=from_here)

    def touch(self, pose_base_peg_start: Pose, direction_base: Sequence[float]) -> Touch | None:
        """See Tools."""
        config = self._run.config
        return touch_from(
            self._run,
            pose_base_peg_start,
            np.asarray(direction_base, dtype=float),
            config.touch_speed_m_s,
            config.touch_threshold_n,
            slow_travel_m=2.0 * config.standoff_m,
        )

    def withdraw(self, pose_base_hole: Pose, distance_m: float | None = None) -> None:
        """See Tools."""
        withdraw(self._run, pose_base_hole, self._run.config.standoff_m if distance_m is None else distance_m)

    def feel(self, duration_s: float = 0.1) -> ContactReading:
        """See Tools."""
        return feel(self._run, duration_s)[1]

    def estimate(self, prior: PosePrior, touches: Sequence[Touch] | None = None) -> PoseErrorEstimate:
        """See Tools."""
        asked = EstimatePose(prior=prior, touches=tuple(self._run.touches if touches is None else touches))
        return self._told(self._run.ports.ask(ESTIMATE, asked))

    def estimate_by_network(self, touch: Touch, pose_base_hole: Pose) -> PoseErrorEstimate:
        """See Tools."""
        asked = EstimateByNetwork(touch=touch, pose_base_hole_believed=PoseData.of(pose_base_hole))
        return self._told(self._run.ports.ask(NETWORK, asked))

    def next_touch(self, belief: PosePrior, failed_pushes: int) -> TouchPlan:
        """See Tools."""
        asked = NextTouch(belief=belief, touches_made=len(self._run.touches), failed_pushes=failed_pushes)
        return self._run.ports.ask(NEXT_TOUCH, asked)

    def tell(self, text: str, **figures: float) -> None:
        """See Tools."""
        self._run.tell(Phase.ESTIMATING, text, **figures)

    def give_up(self, reason: str) -> NoReturn:
        """See Tools."""
        raise AssemblyFailed(Failure.NOT_CONVERGED, reason)

    def _told(self, estimate: PoseErrorEstimate) -> PoseErrorEstimate:
        report_estimate(self._run, estimate)
        return estimate

    def _believe(self, pose_base_hole: Pose) -> None:
        """As ours: where the hole cannot be by the cell's drawing nothing is driven to, whoever believes it."""
        if not self._run.hole.is_plausible_hole_pose(pose_base_hole):
            x, y, z = pose_base_hole.translation_m * 1e3
            raise AssemblyFailed(
                Failure.UNREACHABLE,
                f"the hole cannot be at ({x:.0f}, {y:.0f}, {z:.0f}) mm so turned, by cell.hole_prior",
            )
        self._run.hole.believed = pose_base_hole
