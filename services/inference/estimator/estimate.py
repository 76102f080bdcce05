"""From touches and a prior to the pose of the hole: starts, fit, covariance and verdicts."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rotation import rotation_of
from services.inference.estimator.fit import SOFT_GAP_M, FitState, descend, evaluate
from services.inference.estimator.hypotheses import (
    TouchBatch,
    TrialPoses,
    candidate_geometry,
    contact_basis,
    relative_poses,
)
from services.inference.estimator.observation import (
    ContactHypothesis,
    EstimatorSettings,
    HolePosePrior,
    HolePosterior,
    TouchObservation,
    TouchVerdict,
)
from services.inference.estimator.posterior import posterior
from services.inference.mechanics import PairTables, first_contacts

KIND_NAMES = ("peg corner on face", "peg face on corner", "edge on edge")
STAGES = 4
STAGE_STEPS = 4
LAST_SOFTNESS = 0.08
FINAL_STEPS = 8
PATIENCE = 6.0
WIDE_SOFTNESS = 4.0


def estimate_pose(
    tables: PairTables,
    prior: HolePosePrior,
    touches: Sequence[TouchObservation],
    rng: np.random.Generator,
    settings: EstimatorSettings | None = None,
    previous: HolePosterior | None = None,
) -> HolePosterior:
    """The hole's pose (MAP) from all touches of one assembly. Starts: prior samples, the prior's mean, `previous`.

    Every touch gets a verdict, in order. Without an informative touch the prior is returned.
    """
    settings = settings or EstimatorSettings()
    informative = [touch for touch in touches if touch.informative]
    if not informative:
        verdicts = tuple(TouchVerdict(False, np.inf, (), "not informative") for _ in touches)
        return HolePosterior(
            prior.pose_base_hole, prior.covariance, 0, 0.0, settings.friction_mean, settings.friction_sd, verdicts
        )
    batch = TouchBatch.of(informative, settings)
    wider = dataclasses.replace(
        settings, samples=4 * settings.samples, starts=2 * settings.starts, finalists=2 * settings.finalists
    )
    # With a prior that wide face, rim and walls are all possible, and one touch may not tell which.
    usual = wider if _first_softness(prior) >= WIDE_SOFTNESS else settings
    state = _search(tables, prior, batch, rng, usual, _known(previous))
    for retry in range(settings.retries):
        # A badly explained touch may be an outlier, or the search may have missed: search again before it is given up.
        costs = state.touch_cost[np.argmin(state.cost)]
        if costs.max() < settings.doubtful:
            break
        known = _without(tables, prior, batch, rng, settings, costs, retry)
        again = _search(tables, prior, batch, rng, wider, known)
        state = again if again.cost.min() < state.cost.min() else state
    return _conclude(state, tables, batch, prior, touches, rng, settings)


def _known(previous: HolePosterior | None) -> TrialPoses | None:
    """The poses of an earlier estimate as starts."""
    if previous is None:
        return None
    kept = [previous.pose_base_hole, *previous.alternatives][:3]
    return TrialPoses(
        np.array([pose.rotation for pose in kept]),
        np.array([pose.translation_m for pose in kept]),
        np.full(len(kept), previous.friction_coefficient),
    )


def _without(
    tables: PairTables,
    prior: HolePosePrior,
    batch: TouchBatch,
    rng: np.random.Generator,
    settings: EstimatorSettings,
    costs: Array,
    retry: int,
) -> TrialPoses | None:
    """Starts for one more search: posterior draws without one touch, the worst explained first."""
    if len(costs) < 2:
        return None
    left_out = int(np.argsort(-costs, kind="stable")[retry % len(costs)])
    others = batch.picked(np.delete(np.arange(len(costs)), left_out))
    state = _search(tables, prior, others, rng, settings, None)
    found = posterior(tables, state, others, prior, settings, rng)
    picked = rng.choice(len(found.weight), size=settings.samples // 2, p=found.weight)
    starts = found.draws[picked]
    return TrialPoses(starts.rotation, starts.translation_m, starts.friction)


def _search(
    tables: PairTables,
    prior: HolePosePrior,
    batch: TouchBatch,
    rng: np.random.Generator,
    settings: EstimatorSettings,
    known: TrialPoses | None,
) -> FitState:
    """One annealed multi-start fit; the few best trials at the true noise."""
    first = _first_softness(prior)
    trials = _starts(tables, prior, batch, rng, settings, known, first)
    # During the search a touch is gated only if nothing near explains it; else explaining no touch would be the best
    # choice.
    patient = dataclasses.replace(settings, gate=PATIENCE * settings.gate)
    for softness in np.geomspace(first, LAST_SOFTNESS, STAGES):
        state = descend(tables, trials, batch, prior, patient, float(softness), STAGE_STEPS)
        trials = _distinct(state, settings.starts)
    state = descend(tables, trials, batch, prior, patient, 0.0, FINAL_STEPS)
    state = evaluate(tables, state.trials, batch, prior, settings, 0.0)
    return descend(tables, _distinct(state, settings.finalists), batch, prior, settings, 0.0, FINAL_STEPS // 2)


def _first_softness(prior: HolePosePrior) -> float:
    """Softness 1 tolerates gaps of 0.3 mm; a wider prior has to start softer."""
    return float(np.clip(np.sqrt(prior.covariance[:2, :2].trace() / 2.0) / SOFT_GAP_M, 1.0, 4.0))


def _starts(
    tables: PairTables,
    prior: HolePosePrior,
    batch: TouchBatch,
    rng: np.random.Generator,
    settings: EstimatorSettings,
    known: TrialPoses | None,
    softness: float,
) -> TrialPoses:
    """The best of samples from the prior, each moved along the last push until it just touches; and the known poses."""
    count = max(settings.samples // len(batch.wrench), 40)
    spread = rng.multivariate_normal(np.zeros(6), prior.covariance, size=count)
    spread[1::2] *= 1.6
    spread[0] = 0.0
    base = prior.pose_base_hole
    samples = TrialPoses(
        np.repeat(base.rotation[None], count, axis=0),
        np.repeat(base.translation_m[None], count, axis=0),
        np.full(count, settings.friction_mean),
    ).moved(np.column_stack([spread, np.zeros(count)]))
    last = len(batch.wrench) - 1
    rotation, translation, motion = relative_poses(samples, batch)
    travel = first_contacts(tables, rotation[:, last], translation[:, last], motion[:, last]).travel_m.min(axis=1)
    travel = np.where(np.isfinite(travel), np.clip(travel, -0.03, 0.03), 0.0)
    # A sample that would have to slide far along a bore must not take the depth out of the prior.
    moved = TrialPoses(
        samples.rotation, samples.translation_m - travel[:, None] * batch.motion_base[last], samples.friction
    ).slipping(len(batch.wrench), settings.gap_sd_m, rng)
    pool = [moved]
    if known is not None:
        pool.append(known)
    everyone = TrialPoses.joined(pool)
    state = evaluate(tables, everyone, batch, prior, settings, softness)
    best = np.argsort(state.cost, kind="stable")[: 2 * settings.starts]
    forced = np.arange(count, len(everyone.rotation))[: settings.starts]
    return everyone[np.unique(np.concatenate([best, forced]))]


def _distinct(state: FitState, count: int) -> TrialPoses:
    """The best `count` trials that differ by more than 0.05 mm or 1 mrad from every better one."""
    kept: list[int] = []
    trials = state.trials
    for index in np.argsort(state.cost, kind="stable"):
        near = False
        for other in kept:
            distance = np.linalg.norm(trials.translation_m[index] - trials.translation_m[other])
            angle = rotation_of(trials.rotation[other].T @ trials.rotation[index]).magnitude()
            near = near or bool(distance < 5e-5 and angle < 1e-3)
        if not near:
            kept.append(int(index))
        if len(kept) == count:
            break
    return trials[np.array(kept)]


def _conclude(
    state: FitState,
    tables: PairTables,
    batch: TouchBatch,
    prior: HolePosePrior,
    touches: Sequence[TouchObservation],
    rng: np.random.Generator,
    settings: EstimatorSettings,
) -> HolePosterior:
    """The posterior about the best trial, and the verdict on each touch."""
    found = posterior(tables, state, batch, prior, settings, rng)
    order = np.argsort(state.cost, kind="stable")
    best = found.mode
    trials = state.trials
    poses = [Pose(trials.rotation[i], trials.translation_m[i]) for i in range(len(order))]
    root = np.linalg.cholesky(prior.covariance)
    white = np.linalg.solve(root, np.linalg.solve(root, found.covariance[:6, :6]).T)
    rank = int(np.count_nonzero(np.linalg.eigvalsh(0.5 * (white + white.T)) < 0.25))
    geometry = candidate_geometry(state.chosen.features, trials, batch)
    basis = contact_basis(geometry, trials, batch)
    verdicts: list[TouchVerdict] = []
    row = 0
    for touch in touches:
        if not touch.informative:
            verdicts.append(TouchVerdict(False, np.inf, (), "not informative"))
            continue
        cost = float(state.touch_cost[best, row])
        used = cost < settings.gate
        contacts = _contacts(state, best, row, basis, geometry.point_peg_m, batch, tables)
        verdicts.append(TouchVerdict(used, cost, contacts, "" if used else "no contact hypothesis explains it"))
        row += 1
    used_costs = [verdict.cost for verdict in verdicts if verdict.used]
    return HolePosterior(
        found.pose_base_hole,
        found.covariance[:6, :6],
        rank,
        float(np.mean(used_costs)) if used_costs else float("inf"),
        found.friction,
        float(np.sqrt(found.covariance[6, 6])),
        tuple(verdicts),
        tuple(poses[i] for i in order if i != best and state.cost[i] - state.cost[best] < 20.0),
    )


def _contacts(
    state: FitState, best: int, row: int, basis: Array, points: Array, batch: TouchBatch, tables: PairTables
) -> tuple[ContactHypothesis, ...]:
    """Name the contacts that explain one touch."""
    columns = state.chosen.columns[best, row][state.chosen.pressing[best, row]]
    matrix = (basis[best, row, columns] / batch.sd[row]).T
    forces = np.linalg.lstsq(matrix, batch.wrench[row] / batch.sd[row], rcond=None)[0]
    blocks = tables.shape[1]
    named = []
    for column, force in zip(columns, forces, strict=True):
        x, y, z = (float(value) for value in points[best, row, column])
        arm = int(np.round(np.arctan2(y, x) / (np.pi / 2))) % 4 + 1
        kind = KIND_NAMES[int(state.chosen.features.kind[best, row, column])]
        block = int(state.chosen.pair[best, row, column]) % blocks
        named.append(ContactHypothesis(kind, arm, block, float(force), (x, y, z)))
    return tuple(named)
