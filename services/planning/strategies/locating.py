"""The hole as vision sees it."""

from __future__ import annotations

import numpy as np

from crosspih_common.errors import CommandRefused
from crosspih_common.keys import LOCATE
from crosspih_common.messages import Failure, HoleEstimate, LocateHole, LocateMethod, Phase
from services.planning.ports import AssemblyFailed
from services.planning.run import Run


def locate(run: Run, method: LocateMethod) -> HoleEstimate:
    """Ask vision, which itself looks again under another light before it refuses; AssemblyFailed when it does."""
    run.tell(Phase.LOCATING, f"looking for the hole ({method.value})")
    try:
        seen = run.ports.ask(LOCATE, LocateHole(method=method))
    except CommandRefused as refusal:
        run.hole.vision_refused = str(refusal)
        run.tell(Phase.LOCATING, f"vision refused: {refusal}")
        raise AssemblyFailed(Failure.NOT_SEEN, str(refusal)) from refusal
    sd = np.sqrt(np.diag(np.asarray(seen.covariance).reshape(6, 6)))
    x, y, z = seen.pose_base_hole.position_m
    run.tell(
        Phase.LOCATING,
        f"hole at ({x * 1e3:.1f}, {y * 1e3:.1f}, {z * 1e3:.1f}) mm",
        sd_lateral_mm=float(np.hypot(sd[0], sd[1])) * 1e3,
        sd_depth_mm=float(sd[2]) * 1e3,
        sd_tilt_deg=float(np.rad2deg(np.hypot(sd[3], sd[4]))),
    )
    run.hole.vision_pose = run.hole.believed = seen.pose_base_hole.pose()
    run.hole.vision_covariance = seen.covariance
    run.hole.vision_warnings = seen.warnings
    return seen
