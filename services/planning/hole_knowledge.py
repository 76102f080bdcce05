"""What an assembly knows about the pose of the hole, and from which source."""

from __future__ import annotations

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import PosePrior

IN_RANGE = 2.0  # times the half ranges of the drawing
IN_RANGE_RAD = 0.5


class HoleKnowledge:
    """The hole's pose by vision, by the request, and by the present estimate."""

    def __init__(self, workcell: Workcell) -> None:
        self._drawn = workcell.hole_prior
        self.vision_pose: Pose | None = None
        self.vision_covariance: tuple[float, ...] = ()  # (36,) of it, as in HoleEstimate
        self.vision_refused = ""
        self.vision_warnings: tuple[str, ...] = ()
        self.felt_for = False  # found by force alone, although vision was asked first
        self.believed: Pose | None = None
        self.known: PosePrior | None = None  # told with the request

    def is_plausible_hole_pose(self, pose_base_hole: Pose) -> bool:
        """Whether the hole can be at this pose at all; the arm must not move to an implausible estimate."""
        off = self._drawn.pose_base_hole().inverse() @ pose_base_hole
        reach_m = IN_RANGE * self._drawn.half_ranges()[:3]
        near = bool(np.all(np.abs(off.translation_m) < reach_m))
        return near and float(np.linalg.norm(off.rotvec_rad())) < IN_RANGE_RAD
