"""An estimate of the pose error told, and the peg driven to before the hole that it speaks of."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.messages import Phase, PoseErrorEstimate
from services.planning.run import Run


def report_estimate(run: Run, estimate: PoseErrorEstimate) -> None:
    """Angles in degrees and lengths in mm, for people."""
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
    """Believe the hole there from now on, and stand before it."""
    run.counts.corrections += 1
    run.hole.believed = pose_base_hole
    run.tell(Phase.CORRECTING, f"correction {run.counts.corrections}")
    run.motion.slide_to(run.motion.before_hole(pose_base_hole, run.config.standoff_m))
