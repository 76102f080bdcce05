"""Whether what an estimate is asked for can be of this cell at all: what cannot be is refused before it is searched."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import PosePrior, Touch

MOST_PRIOR_M, MOST_PRIOR_RAD = 0.5, np.pi  # standard deviations: beyond these a prior says nothing
FAR_M = 0.5  # from the believed rim to the peg's tip: a touch there was on something else
MOST_FORCE_N, MOST_MOMENT_NM = 1e5, 1e4  # of the largest wrist sensors that are made, several times


def refuse_implausible_prior(prior: PosePrior, name: str) -> None:
    """Raises CommandRefused `implausible`. `name` is the field's, for the text."""
    sd = np.sqrt(np.asarray(prior.covariance).reshape(6, 6).diagonal())
    if sd[:3].max() > MOST_PRIOR_M or sd[3:].max() > MOST_PRIOR_RAD:
        raise CommandRefused(
            "implausible",
            f"{name}.covariance: its standard deviations are up to {sd[:3].max():.3g} m and {sd[3:].max():.3g} rad; "
            f"give at most {MOST_PRIOR_M:g} m and {MOST_PRIOR_RAD:.3g} rad",
        )


def refuse_implausible_peg(pose_base_peg: Pose, tip_m: float, pose_base_hole: Pose, name: str) -> None:
    """Raises CommandRefused `implausible` where the tip (`tip_m` along z of the peg) is nowhere near the hole."""
    away_m = float(np.linalg.norm(pose_base_peg.apply([0.0, 0.0, tip_m]) - pose_base_hole.translation_m))
    if away_m > FAR_M:
        raise CommandRefused(
            "implausible", f"{name}: the peg's tip is {away_m:.3g} m from the believed hole; at most {FAR_M:g} m can be"
        )


def refuse_implausible_wrench(wrench: Sequence[float] | Array, name: str) -> None:
    """Raises CommandRefused `implausible` for (6,) N and Nm that no wrist sensor can feel."""
    forces, moments = np.abs(np.asarray(wrench)).reshape(2, 3)
    if forces.max() > MOST_FORCE_N or moments.max() > MOST_MOMENT_NM:
        raise CommandRefused(
            "implausible",
            f"{name}: {forces.max():.3g} N and {moments.max():.3g} Nm; at most {MOST_FORCE_N:g} N and "
            f"{MOST_MOMENT_NM:g} Nm can be",
        )


def refuse_implausible_touches(prior: PosePrior, touches: Sequence[Touch], tip_m: float) -> None:
    """Of a whole request; raises CommandRefused `implausible`, which names the touch and its field."""
    refuse_implausible_prior(prior, "prior")
    hole = prior.pose_base_hole.pose()
    for index, touch in enumerate(touches):
        refuse_implausible_peg(touch.pose_base_peg.pose(), tip_m, hole, f"touches.{index}.pose_base_peg")
        refuse_implausible_wrench(touch.wrench, f"touches.{index}.wrench")
        refuse_implausible_wrench(touch.wrench_sd, f"touches.{index}.wrench_sd")
