"""The coverage of the posterior, and how fast touches narrow it: simulated trials with stated errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import beta, chi2

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.inference.estimator.estimate import estimate_pose
from services.inference.estimator.observation import EstimatorSettings, HolePosePrior, TouchObservation
from services.inference.estimator.synthetic import GuardedPush, TouchNoise, touch
from services.inference.mechanics import PairTables

# the parts of a pose that are evaluated one by one: indices of x, y, z, rx, ry, rz
BLOCKS = {
    "lateral": np.array([0, 1]),
    "rotation": np.array([3, 4, 5]),
    "without depth": np.array([0, 1, 3, 4, 5]),
    "all six": np.arange(6),
}
# start pose and direction of the next touch from belief, covariance, touches made, last touch used
Policy = Callable[[Pose, Array, int, bool], tuple[Pose, Array]]


@dataclass(frozen=True, slots=True)
class TrialSettings:
    """A trial: the prior's sds (hole frame), touches, the true friction's range, and the touches' own errors."""

    prior_sd: tuple[float, ...]
    touches: int = 4
    friction: tuple[float, float] = (0.05, 0.15)
    noise: TouchNoise = field(default_factory=TouchNoise)
    push: GuardedPush = field(default_factory=GuardedPush)


@dataclass(frozen=True, slots=True)
class TouchRecord:
    """After touch number k: squared error over covariance of each block, errors, and the kind of the last touch."""

    trial: int
    touches: int
    nees: dict[str, float]
    lateral_m: float
    rotation_rad: float
    turn_rad: float
    contacts: int
    used: bool
    named: int


def run_trial(
    tables: PairTables,
    nominal: Pose,
    compliance_peg: Array,
    policy: Policy,
    estimator: EstimatorSettings,
    settings: TrialSettings,
    seed: int,
) -> Iterator[TouchRecord]:
    """One trial: a hole drawn from the prior about the nominal one, touches by the policy, a record after each."""
    rng = np.random.default_rng(seed)
    sd = np.asarray(settings.prior_sd)
    error = rng.normal(size=6) * sd
    truth = nominal @ Pose.from_rotvec(error[3:], error[:3]).inverse()
    friction = float(rng.uniform(*settings.friction))
    prior = HolePosePrior(nominal, np.diag(sd**2))
    belief, covariance, used = prior.pose_base_hole, prior.covariance, True
    made: list[TouchObservation] = []
    missed = 0
    while len(made) < settings.touches and missed < settings.touches:
        start, direction = policy(belief, covariance, len(made) + missed, used)
        felt = touch(tables, truth, start, direction, compliance_peg, friction, rng, settings.noise, settings.push)
        if felt is None:
            missed += 1
            continue
        made.append(felt.observation)
        found = estimate_pose(tables, prior, made, np.random.default_rng(seed), estimator)
        belief, covariance, used = found.pose_base_hole, found.covariance, found.touches[-1].used
        between = belief.inverse() @ truth
        off = np.concatenate([between.translation_m, between.rotvec_rad()])
        nees = {
            name: float(off[keep] @ np.linalg.solve(covariance[np.ix_(keep, keep)], off[keep]))
            for name, keep in BLOCKS.items()
        }
        yield TouchRecord(
            seed,
            len(made),
            nees,
            float(np.hypot(*off[:2])),
            float(np.linalg.norm(off[3:])),
            float(abs(off[5])),
            felt.contacts,
            used,
            len(found.touches[-1].contacts),
        )


@dataclass(frozen=True, slots=True)
class CoverageRow:
    """After k touches: trials, share of truths within the 95 % region with its 95 % interval (Clopper-Pearson) and
    the quantiles of the squared error over covariance, block by block; and the errors' p50 and p95."""

    touches: int
    trials: int
    covered: dict[str, tuple[float, float, float]]
    nees_p50_p95: dict[str, tuple[float, float]]
    lateral_mm: tuple[float, float]
    rotation_deg: tuple[float, float]
    several_contacts: float
    used: float


def summary(records: Sequence[TouchRecord]) -> list[CoverageRow]:
    """One row per number of touches."""
    rows = []
    for count in sorted({record.touches for record in records}):
        these = [record for record in records if record.touches == count]
        covered, quantiles = {}, {}
        for name, keep in BLOCKS.items():
            values = np.array([record.nees[name] for record in these])
            inside = int(np.count_nonzero(values <= chi2.ppf(0.95, len(keep))))
            low = float(beta.ppf(0.025, inside, len(these) - inside + 1)) if inside else 0.0
            high = float(beta.ppf(0.975, inside + 1, len(these) - inside)) if inside < len(these) else 1.0
            covered[name] = (inside / len(these), low, high)
            quantiles[name] = (float(np.percentile(values, 50)), float(np.percentile(values, 95)))
        lateral = np.percentile([record.lateral_m for record in these], [50, 95]) * 1e3
        rotation = np.degrees(np.percentile([record.rotation_rad for record in these], [50, 95]))
        rows.append(
            CoverageRow(
                count,
                len(these),
                covered,
                quantiles,
                (float(lateral[0]), float(lateral[1])),
                (float(rotation[0]), float(rotation[1])),
                float(np.mean([record.contacts > 1 for record in these])),
                float(np.mean([record.used for record in these])),
            )
        )
    return rows
