"""What an assembly knows of where the hole is, and by what."""

from __future__ import annotations

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import PosePrior

IN_RANGE = 2.0  # times the half ranges of the drawing
IN_RANGE_RAD = 0.5


class HoleKnowledge:
    """As vision saw it, as it was told with the request, and as it is believed now."""

    def __init__(self, workcell: Workcell) -> None:
        self._drawn = workcell.hole_prior
        self.vision_pose: Pose | None = None
        self.vision_covariance: tuple[float, ...] = ()  # (36,) of it, as in HoleEstimate
        self.vision_refused = ""
        self.vision_warnings: tuple[str, ...] = ()
        self.felt_for = False  # by force alone, though vision was asked
        self.believed: Pose | None = None
        self.known: PosePrior | None = None  # told with the request

    def is_plausible_hole_pose(self, pose_base_hole: Pose) -> bool:
        """Whether the hole can be there at all; an estimate that says otherwise must not be driven to."""
        off = self._drawn.pose_base_hole().inverse() @ pose_base_hole
        reach_m = IN_RANGE * self._drawn.half_ranges()[:3]
        near = bool(np.all(np.abs(off.translation_m) < reach_m))
        return near and float(np.linalg.norm(off.rotvec_rad())) < IN_RANGE_RAD
