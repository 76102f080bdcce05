"""The robust maximum-a-posteriori fit of the hole's pose and the friction to all touches so far.

Levenberg-Marquardt from many starts at once. The contact hypotheses are chosen anew in every step while the whitening
tightens from tenths of a millimetre to the true noise, so a start need not have the right features at first. A
touch that no hypothesis explains loses its weight (Geman-McClure).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rotation import rotation_of
from services.inference.estimator.hypotheses import (
    ChosenContacts,
    TouchBatch,
    TrialPoses,
    candidate_geometry,
    choose_contacts,
    contact_basis,
)
from services.inference.estimator.observation import EstimatorSettings, HolePosePrior
from services.inference.mechanics import ContactFeatures, PairTables

# Extra sd while annealing: gap, force, moment at softness 1.
SOFT_GAP_M = 3e-4
SOFT_FORCE_N = 0.5
SOFT_MOMENT_NM = 0.02
LARGEST_STEP = np.array([2e-3, 2e-3, 3e-3, 0.03, 0.03, 0.03, 0.1])
STEP_DIFFERENCE = 1e-6
RANGE_SD_M = 2e-3
RANGE_TAIL_DEGREES = 200.0


@dataclass(frozen=True, slots=True, eq=False)
class FitState:
    """K fitted trials: poses, costs (K,), costs per touch (K, T), weights (K, T), information (K, 7, 7), contacts."""

    trials: TrialPoses
    cost: Array
    touch_cost: Array
    information: Array
    chosen: ChosenContacts

    def replaced(self, other: FitState, where: NDArray[np.bool_]) -> FitState:
        """The state with the trials of `other` where the mask (K,) is true."""

        def pick(theirs: NDArray[Any], ours: NDArray[Any]) -> NDArray[Any]:
            return np.asarray(np.where(where.reshape(-1, *(1,) * (ours.ndim - 1)), theirs, ours))

        mine, yours = self.chosen, other.chosen
        names = ("kind", "peg_point_m", "peg_direction", "hole_point_m", "hole_direction", "sign")
        features = ContactFeatures(
            *(pick(getattr(yours.features, name), getattr(mine.features, name)) for name in names)
        )
        return FitState(
            TrialPoses(
                pick(other.trials.rotation, self.trials.rotation),
                pick(other.trials.translation_m, self.trials.translation_m),
                pick(other.trials.friction, self.trials.friction),
                self.trials.slip,
            ),
            pick(other.cost, self.cost),
            pick(other.touch_cost, self.touch_cost),
            pick(other.information, self.information),
            ChosenContacts(
                features,
                pick(yours.columns, mine.columns),
                pick(yours.pressing, mine.pressing),
                pick(yours.overlapping, mine.overlapping),
                pick(yours.cost, mine.cost),
                pick(yours.pair, mine.pair),
            ),
        )


def whitening(touches: TouchBatch, settings: EstimatorSettings, softness: float) -> tuple[float, Array]:
    """Gap sd (m) and wrench sds (T, 6) at a softness from 1 (coarse) to 0 (the true noise)."""
    # A wide prior is wide in position; the wrench that identifies the touching feature needs no softer noise.
    soft = np.repeat([SOFT_FORCE_N, SOFT_MOMENT_NM], 3) * min(softness, 1.0)
    return float(np.hypot(settings.gap_sd_m, SOFT_GAP_M * softness)), np.sqrt(touches.sd**2 + soft**2)


def soft_gate(settings: EstimatorSettings, softness: float) -> float:
    """The gate at a softness: no touch is gated before the hypotheses have settled."""
    return settings.gate * (1.0 + 20.0 * softness)


def robust_cost(cost: Array, gate: float) -> Array:
    """Geman-McClure: cost near zero, at most `gate`."""
    return np.asarray(cost * gate / (cost + gate))


def prior_terms(trials: TrialPoses, prior: HolePosePrior, settings: EstimatorSettings) -> tuple[Array, Array, Array]:
    """Cost (K,), gradient (K, 7) and information (K, 7, 7) of the prior with its Student-t tails."""
    relative = prior.pose_base_hole.rotation.T @ trials.rotation
    error = np.concatenate(
        [
            (trials.translation_m - prior.pose_base_hole.translation_m) @ prior.pose_base_hole.rotation,
            rotation_of(relative).as_rotvec(),
        ],
        axis=1,
    )
    precision = np.linalg.inv(prior.covariance)
    jacobian = np.zeros((len(relative), 6, 6))
    jacobian[:, :3, :3] = relative
    jacobian[:, 3:, 3:] = np.eye(3)
    distance = np.einsum("ki,ij,kj->k", error, precision, error)
    # A prior as wide as the workcell's is a range, not a measurement: heavy tails make no sense there.
    a_range = float(np.sqrt(prior.covariance[:2, :2].trace() / 2.0)) > RANGE_SD_M
    nu = max(prior.tail_degrees, RANGE_TAIL_DEGREES) if a_range else prior.tail_degrees
    weight = (nu + 6.0) / (nu + distance)
    gradient = np.zeros((len(relative), 7))
    gradient[:, :6] = weight[:, None] * np.einsum("kji,jl,kl->ki", jacobian, precision, error)
    information = np.zeros((len(relative), 7, 7))
    information[:, :6, :6] = weight[:, None, None] * (np.swapaxes(jacobian, 1, 2) @ precision @ jacobian)
    friction_error = (trials.friction - settings.friction_mean) / settings.friction_sd
    gradient[:, 6] = friction_error / settings.friction_sd
    information[:, 6, 6] = 1.0 / settings.friction_sd**2
    cost = (nu + 6.0) * np.log1p(distance / nu) + friction_error**2
    return cost, gradient, information


def linearise(
    chosen: ChosenContacts, trials: TrialPoses, touches: TouchBatch, gap_sd_m: float, wrench_sd: Array
) -> tuple[Array, Array]:
    """Residuals (K, T, 6 + C + Q) and Jacobian (.., 7): wrench, gaps, overlaps; the forces are projected out."""
    k, t, q = chosen.features.kind.shape
    c = int(chosen.pressing.sum(axis=-1).max())
    chosen_columns, pressing = chosen.columns[..., :c], chosen.pressing[..., :c]
    steps = np.vstack([np.zeros(7), np.eye(7) * STEP_DIFFERENCE])
    many = TrialPoses(
        np.repeat(trials.rotation, 8, axis=0),
        np.repeat(trials.translation_m, 8, axis=0),
        np.repeat(trials.friction, 8, axis=0),
    ).moved(np.tile(steps, (k, 1)))
    # The clip of the friction must not hide its derivative.
    many = TrialPoses(many.rotation, many.translation_m, np.repeat(trials.friction, 8) + np.tile(steps[:, 6], k))
    every = np.repeat(np.arange(k), 8)
    gap = candidate_geometry(chosen.features[every], many, touches).gap_m.reshape(k, 8, t, q)
    at = (np.arange(k)[:, None, None], np.arange(t)[None, :, None], chosen_columns)
    pressed = candidate_geometry(chosen.features[at][every], many, touches)
    basis = contact_basis(pressed, many, touches).reshape(k, 8, t, c, 6) / wrench_sd[None, None, :, None]
    pair = basis * pressing[:, None, ..., None]
    pair_gap = pressed.gap_m.reshape(k, 8, t, c) * pressing[:, None]

    target = (touches.wrench / wrench_sd)[None]
    here = pair[:, 0]
    gram = here @ np.swapaxes(here, -1, -2)
    gram = gram + np.eye(c) * np.where(pressing, 0.0, 1.0)[..., None, :] * np.eye(c)
    gram = gram + 1e-9 * np.einsum("ktii->kt", gram)[..., None, None] * np.eye(c)
    force = np.linalg.solve(gram, np.einsum("ktci,kti->ktc", here, np.broadcast_to(target, (k, t, 6)))[..., None])[
        ..., 0
    ]
    force = np.maximum(force, 0.0)
    residual_wrench = target - np.einsum("ktci,ktc->kti", here, force)
    change = (pair[:, 1:] - here[:, None]) / STEP_DIFFERENCE
    slope = -np.einsum("kptci,ktc->ktip", change, force)
    # Variable projection (Kaufman): a change that the forces can follow is no residual.
    inside = np.linalg.solve(gram, here @ slope)
    slope = slope - np.swapaxes(here, -1, -2) @ inside
    residual_gap = pair_gap[:, 0] / gap_sd_m
    slope_gap = np.moveaxis(pair_gap[:, 1:] - pair_gap[:, :1], 1, -1) / (STEP_DIFFERENCE * gap_sd_m)
    residual_overlap = np.where(chosen.overlapping, gap[:, 0], 0.0) / gap_sd_m
    slope_overlap = np.moveaxis(gap[:, 1:] - gap[:, :1], 1, -1) / (STEP_DIFFERENCE * gap_sd_m)
    slope_overlap = slope_overlap * chosen.overlapping[..., None]
    return (
        np.concatenate([residual_wrench, residual_gap, residual_overlap], axis=-1),
        np.concatenate([slope, slope_gap, slope_overlap], axis=-2),
    )


def evaluate(
    tables: PairTables,
    trials: TrialPoses,
    touches: TouchBatch,
    prior: HolePosePrior,
    settings: EstimatorSettings,
    softness: float,
) -> FitState:
    """Cost of trials without their information (which stays empty)."""
    gate = soft_gate(settings, softness)
    gap_sd, wrench_sd = whitening(touches, settings, softness)
    chosen = choose_contacts(tables, trials, touches, gap_sd, wrench_sd, settings)
    cost, _, _ = prior_terms(trials, prior, settings)
    cost = cost + robust_cost(chosen.cost, gate).sum(axis=1)
    return FitState(trials, cost, chosen.cost, np.zeros((len(cost), 7, 7)), chosen)


def judge(
    tables: PairTables,
    trials: TrialPoses,
    touches: TouchBatch,
    prior: HolePosePrior,
    settings: EstimatorSettings,
    softness: float,
) -> tuple[FitState, Array]:
    """Trials with their cost, information and gradient (K, 7) at a softness."""
    gate = soft_gate(settings, softness)
    gap_sd, wrench_sd = whitening(touches, settings, softness)
    chosen = choose_contacts(tables, trials, touches, gap_sd, wrench_sd, settings)
    residual, jacobian = linearise(chosen, trials, touches, gap_sd, wrench_sd)
    weight = (gate / (gate + chosen.cost)) ** 2
    cost, gradient, information = prior_terms(trials, prior, settings)
    information = information + np.einsum("kt,ktri,ktrj->kij", weight, jacobian, jacobian)
    gradient = gradient + np.einsum("kt,ktri,ktr->ki", weight, jacobian, residual)
    cost = cost + robust_cost(chosen.cost, gate).sum(axis=1)
    return FitState(trials, cost, chosen.cost, information, chosen), gradient


def descend(
    tables: PairTables,
    trials: TrialPoses,
    touches: TouchBatch,
    prior: HolePosePrior,
    settings: EstimatorSettings,
    softness: float,
    iterations: int,
) -> FitState:
    """Levenberg-Marquardt from every trial at one softness; a step that does not lower a trial's cost is rejected."""
    here, gradient = judge(tables, trials, touches, prior, settings, softness)
    damping = np.full(len(here.cost), 1e-3)
    for _ in range(iterations):
        diagonal = np.einsum("kii->ki", here.information)
        damped = here.information + (damping[:, None] * diagonal)[:, :, None] * np.eye(7)
        move = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        move = move / np.maximum(1.0, np.max(np.abs(move) / LARGEST_STEP, axis=1))[:, None]
        there, slope = judge(tables, here.trials.moved(move), touches, prior, settings, softness)
        better = there.cost < here.cost
        damping = np.where(better, np.maximum(damping / 5.0, 1e-6), np.minimum(damping * 10.0, 1e3))
        here = here.replaced(there, better)
        gradient = np.where(better[:, None], slope, gradient)
    return here
