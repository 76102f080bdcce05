"""What strategies have in common: ask vision, tell an estimate, drive to it."""

from __future__ import annotations

import numpy as np

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.keys import LOCATE
from crosspih_common.messages import (
    Failure,
    HoleEstimate,
    LocateHole,
    LocateMethod,
    Phase,
    PoseErrorEstimate,
)
from services.planning.ports import AssemblyFailed
from services.planning.run import Run


def locate(run: Run, method: LocateMethod) -> HoleEstimate:
    """Ask vision, which itself looks again under another light before it refuses; AssemblyFailed when it does."""
    run.tell(Phase.LOCATING, f"looking for the hole ({method.value})")
    try:
        seen = run.ports.ask(LOCATE, LocateHole(method=method))
    except CommandRefused as refusal:
        run.vision_refused = str(refusal)
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
    run.vision_pose = run.believed = seen.pose_base_hole.pose()
    run.vision_covariance = seen.covariance
    run.vision_warnings = seen.warnings
    return seen


def tell_estimate(run: Run, estimate: PoseErrorEstimate) -> None:
    alpha, beta, gamma = np.rad2deg(estimate.angles_rad)
    x, y, _ = np.asarray(estimate.translation_m) * 1e3
    run.tell(
        Phase.ESTIMATING,
        f"peg is off by ({alpha:.2f}, {beta:.2f}, {gamma:.2f}) deg, ({x:.2f}, {y:.2f}) mm; "
        f"{estimate.method}, rank {estimate.rank}",
        alpha_deg=alpha,
        beta_deg=beta,
        gamma_deg=gamma,
        x_mm=x,
        y_mm=y,
        rank=estimate.rank,
        friction=estimate.friction,
        residual_cost=estimate.residual_cost,
    )


def correct(run: Run, pose_base_hole: Pose) -> None:
    run.corrections += 1
    run.believed = pose_base_hole
    run.tell(Phase.CORRECTING, f"correction {run.corrections}")
    run.slide_to(run.before_hole(pose_base_hole, run.config.standoff_m))
