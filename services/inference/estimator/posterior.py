"""The posterior's mean and covariance by importance sampling about the modes that the fit found.

A Gaussian at the best fit is too narrow: the cost bends where other features begin to touch, and other hypotheses
explain the touches about as well. So the posterior itself is sampled: draws from a mixture of Student-t about all
modes, weighted by posterior over mixture (adaptive multiple importance sampling: Cornuet et al. 2012), give the
moments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rotation import rotation_of
from services.inference.estimator.fit import FitState, evaluate
from services.inference.estimator.hypotheses import TouchBatch, TrialPoses
from services.inference.estimator.observation import EstimatorSettings, HolePosePrior
from services.inference.mechanics import PairTables

DEGREES = 5.0
WIDENED = 1.3
FEWEST_SHARE = 0.04  # of the draws for each mode, however unlikely the fit finds it
CREDIBLE_COST = 40.0
PRIOR_SHARE = 0.1  # of the draws for the prior itself
TRUSTED_DRAWS = 15.0


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """pose_base_hole and friction with their joint covariance (7, 7); the mode of the fit they belong to; the effective
    number of independent draws; and the draws with their weights."""

    pose_base_hole: Pose
    friction: float
    covariance: Array
    mode: int
    effective_draws: float
    draws: TrialPoses
    weight: Array


def posterior(
    tables: PairTables,
    state: FitState,
    touches: TouchBatch,
    prior: HolePosePrior,
    settings: EstimatorSettings,
    rng: np.random.Generator,
) -> Posterior:
    """Mean and covariance about the mode with the largest share of the posterior; the covariance includes the other
    modes."""
    kept = np.flatnonzero(state.cost < state.cost.min() + CREDIBLE_COST)
    modes = state.trials[kept]
    own = np.array([_symmetric(np.linalg.inv(state.information[index])) for index in kept])
    share = _normalised(-0.5 * state.cost[kept] + 0.5 * np.linalg.slogdet(own)[1])
    share = (1.0 - FEWEST_SHARE * len(kept)) * share + FEWEST_SHARE if len(kept) * FEWEST_SHARE < 0.5 else share
    sampler = _Sampler(modes, np.linalg.cholesky(own), share, _prior_component(prior, settings))
    for _ in range(settings.rounds):
        sample = sampler.draw(settings.draws, rng).slipping(len(touches.wrench), settings.gap_sd_m, rng)
        sampler.take(sample, -0.5 * evaluate(tables, sample, touches, prior, settings, 0.0).cost)
        weight, nearest = sampler.weights()
        effective = float(1.0 / np.sum(weight**2))
        if effective >= settings.wanted_draws:
            break
        sampler.adapt(weight, nearest)
    everyone = TrialPoses.joined(sampler.drawn)
    held = np.bincount(nearest, weight, len(kept))
    mode = int(held.argmax())

    centre = modes[np.array([mode])]
    off = step_between(everyone, centre)[:, 0]
    near = nearest == mode
    trusted = effective / (effective + TRUSTED_DRAWS)
    mean = trusted * (weight[near] @ off[near]) / max(held[mode], 1e-9)
    around = off - mean
    spread = (around * weight[:, None]).T @ around
    fitted = own[mode] + sum(
        float(held[index]) * np.outer(*(2 * [step_between(modes[np.array([index])], centre)[0, 0] - mean]))
        for index in range(len(kept))
        if index != mode
    )
    moved = centre.moved(mean[None])
    return Posterior(
        Pose(moved.rotation[0], moved.translation_m[0]),
        float(moved.friction[0]),
        _symmetric(trusted * spread + (1.0 - trusted) * fitted),
        int(kept[mode]),
        effective,
        everyone,
        weight,
    )


def _prior_component(prior: HolePosePrior, settings: EstimatorSettings) -> tuple[TrialPoses, Array]:
    """The prior of pose and friction as a mixture component: centre and root (1, 7, 7)."""
    root = np.zeros((1, 7, 7))
    root[0, :6, :6] = np.linalg.cholesky(np.asarray(prior.covariance, float))
    root[0, 6, 6] = settings.friction_sd
    base = prior.pose_base_hole
    return TrialPoses(base.rotation[None], base.translation_m[None], np.array([settings.friction_mean])), root


class _Sampler:
    """Draws from a growing mixture of Student-t, weighed against the mixture of all rounds (Cornuet et al. 2012)."""

    def __init__(self, modes: TrialPoses, roots: Array, share: Array, prior: tuple[TrialPoses, Array]) -> None:
        self._modes = modes
        # a mode may be spurious, with all its touches gated: then only the prior remains
        self._centres, self._roots = [modes, prior[0]], [roots * WIDENED, prior[1]]
        self._mode_roots = roots
        self._shares = [np.append((1.0 - PRIOR_SHARE) * share, PRIOR_SHARE)]
        self.drawn: list[TrialPoses] = []
        self._log_target: list[Array] = []

    def draw(self, count: int, rng: np.random.Generator) -> TrialPoses:
        """From the newest mixture."""
        centres, roots = TrialPoses.joined(self._centres), np.concatenate(self._roots)
        source = rng.choice(len(roots), size=count, p=self._shares[-1])
        tails = np.sqrt(DEGREES / rng.chisquare(DEGREES, size=count))
        step = np.einsum("kij,kj->ki", roots[source], rng.normal(size=(count, 7))) * tails[:, None]
        return centres[source].moved(step)

    def take(self, sample: TrialPoses, log_target: Array) -> None:
        """Keep draws with the logarithm of the posterior there."""
        self.drawn.append(sample)
        self._log_target.append(log_target)

    def weights(self) -> tuple[Array, NDArray[np.intp]]:
        """Normalised weights (N,) of all draws, and the nearest mode of each."""
        everyone = TrialPoses.joined(self.drawn)
        centres, roots = TrialPoses.joined(self._centres), np.concatenate(self._roots)
        size = np.log(np.abs(np.einsum("mii->mi", roots))).sum(axis=1)
        log_each = -0.5 * (DEGREES + 7.0) * np.log1p(_distances(everyone, centres, roots) / DEGREES) - size
        share = np.zeros(len(roots))
        for one in self._shares:
            share[: len(one)] += one / len(self._shares)
        highest = log_each.max(axis=1)
        log_mixture = highest + np.log(np.exp(log_each - highest[:, None]) @ share)
        weight = _normalised(np.concatenate(self._log_target) - log_mixture)
        return weight, _distances(everyone, self._modes, self._mode_roots).argmin(axis=1)

    def adapt(self, weight: Array, nearest: NDArray[np.intp]) -> None:
        """Add a component for each mode with weight, with the moments of its draws."""
        everyone = TrialPoses.joined(self.drawn)
        held = np.bincount(nearest, weight, len(self._mode_roots))
        added: list[float] = []
        for mode in np.flatnonzero(held > 0.05):
            near = np.flatnonzero(nearest == mode)
            flat = _flattened(weight[near])
            best = everyone[near[[int(np.argmax(weight[near]))]]]
            off = step_between(everyone[near], best)[:, 0]
            mean = flat @ off
            spread = ((off - mean) * flat[:, None]).T @ (off - mean)
            own = self._mode_roots[mode] @ self._mode_roots[mode].T
            moved = best.moved(mean[None])
            self._centres.append(TrialPoses(moved.rotation, moved.translation_m, moved.friction))
            self._roots.append(np.asarray(np.linalg.cholesky(_symmetric(spread + 0.1 * own))[None] * WIDENED))
            added.append(float(held[mode]))
        old = np.zeros(sum(len(root) for root in self._roots) - len(added))
        old[: len(self._mode_roots)] = 0.15 / len(self._mode_roots) + 0.15 * held
        old[len(self._mode_roots)] = PRIOR_SHARE
        share = np.concatenate([old, 0.7 * np.array(added)])
        self._shares.append(share / share.sum())


def _flattened(weight: Array) -> Array:
    """The weights, raised to the highest power that leaves enough effective draws for a covariance."""
    power = 1.0
    while True:
        flat = np.asarray((weight / weight.max()) ** power)
        flat = np.asarray(flat / flat.sum())
        if power < 0.02 or 1.0 / np.sum(flat**2) >= min(25.0, 0.5 * len(weight)):
            return flat
        power *= 0.7


def step_between(samples: TrialPoses, modes: TrialPoses) -> Array:
    """The step (N, M, 7) from every mode to every sample, as `TrialPoses.moved` takes it."""
    back = np.swapaxes(modes.rotation, -1, -2)[None]
    shift = samples.translation_m[:, None] - modes.translation_m[None]
    turn = back @ samples.rotation[:, None]
    rotvec = rotation_of(turn.reshape(-1, 3, 3)).as_rotvec().reshape(*turn.shape[:2], 3)
    friction = samples.friction[:, None] - modes.friction[None]
    moved = np.einsum("nmij,nmj->nmi", np.broadcast_to(back, turn.shape), shift)
    return np.concatenate([moved, rotvec, friction[..., None]], axis=-1)


def _distances(samples: TrialPoses, modes: TrialPoses, roots: Array) -> Array:
    """Squared distance (N, M) of every sample from every mode over its spread."""
    white = np.linalg.solve(roots[None], step_between(samples, modes)[..., None])[..., 0]
    return np.asarray(np.sum(white**2, axis=-1))


def _normalised(log_weight: Array) -> Array:
    weight = np.exp(log_weight - log_weight.max())
    return np.asarray(weight / weight.sum())


def _symmetric(matrix: Array) -> Array:
    return np.asarray(0.5 * (matrix + np.swapaxes(matrix, -1, -2)))
