"""Compares the sequence network with the estimator on the same simulated touches."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.inference.estimator import EstimatorSettings, HolePosePrior, TouchObservation, estimate_pose
from services.inference.mechanics import PairTables
from services.inference.network.sequence.data import SequenceDataset, TouchWorld, touch_sequences
from services.inference.network.sequence.model import SequenceNetwork
from services.inference.network.settings import SEQUENCE_WEIGHTS

# the prior's sds: lateral, depth (m), tilt, turn (rad)
PRIORS = {
    "poor vision: 1 mm, 3 deg": (1e-3, 3e-3, 0.0524, 0.0087),
    "force alone: 3 mm, 0.05 rad": (3e-3, 5e-3, 0.05, 0.05),
}


def world_of(sds: tuple[float, float, float, float], friction: float) -> TouchWorld:
    """Touches by the policy under one prior, one friction and one compliance."""
    lateral, depth, tilt, turn = sds
    return TouchWorld(
        lateral_sd_m=(lateral, lateral),
        depth_sd_m=(depth, depth),
        tilt_sd_rad=(tilt, tilt),
        turn_sd_rad=(turn, turn),
        friction=(friction, friction),
        policy_share=1.0,
        compliance_spread=0.0,
    )


def observations(dataset: SequenceDataset, row: int, world: TouchWorld) -> list[TouchObservation]:
    """One history as input of the estimator; the base frame is the prior's hole frame."""
    compliance = np.diag(np.repeat(world.compliance, 3))
    history = dataset.history
    found = []
    for touch in range(history.wrench.shape[1]):
        wrench = history.wrench[row, touch]
        twist = compliance @ wrench
        deflected = Pose(history.rotation[row, touch], history.translation_m[row, touch])
        commanded = deflected @ Pose.from_rotvec(twist[3:], twist[:3]).inverse()
        reading_sd = np.repeat([world.force_sd_n, world.moment_sd_nm], 3)
        found.append(TouchObservation(commanded, wrench, reading_sd, compliance, history.direction[row, touch]))
    return found


def compare(
    cell: Workcell,
    weights: Path | None,
    trials: int,
    touches: int,
    seed: int,
    tell: Callable[[str, int, int], None],
) -> dict[str, Any]:
    """Errors after 1 to `touches` touches under each of PRIORS: median and p95, lateral (mm) and rotation (degrees),
    and how often the 95 % region of each holds the truth."""
    peg = cell.peg.shape()
    hole = cell.hole.shape(peg)
    network = SequenceNetwork.load(weights or SEQUENCE_WEIGHTS, peg)
    tables = PairTables.of(peg, hole)
    settings = EstimatorSettings(friction_mean=cell.friction_expected)
    result: dict[str, Any] = {"command": network.record.command, "trials": trials, "touches": touches, "seed": seed}
    for number, (name, sds) in enumerate(PRIORS.items()):
        world = world_of(sds, cell.friction_expected)
        dataset = touch_sequences(peg, hole, trials, touches, np.random.default_rng([seed, number]), world)
        learned, learned_covariance = network.predict(dataset.history)
        fitted, fitted_covariance = np.empty_like(learned), np.empty_like(learned_covariance)
        for row in range(trials):
            felt = observations(dataset, row, world)
            prior = HolePosePrior(Pose.identity(), np.diag(dataset.history.prior_sd[row] ** 2))
            for count in range(1, touches + 1):
                found = estimate_pose(tables, prior, felt[:count], np.random.default_rng(0), settings)
                pose = found.pose_base_hole
                fitted[row, count - 1] = np.concatenate([pose.translation_m, pose.rotvec_rad()])
                fitted_covariance[row, count - 1] = found.covariance
            tell(f"{name}: touches", (number * trials + row + 1) * touches, len(PRIORS) * trials * touches)
        truth = dataset.error[:, None]
        zero = np.zeros_like(learned[:, :1])
        result[name] = {
            "no touch": _figures(_left(zero, truth), None),
            "sequence network": _figures(_left(learned, truth), learned_covariance),
            "estimator": _figures(_left(fitted, truth), fitted_covariance),
        }
    return result


def _left(found: Array, truth: Array) -> Array:
    """The remaining error (..., 6), as a right perturbation of the estimate."""
    shape = np.broadcast_shapes(found.shape, truth.shape)
    # copies: scipy's rotations accept no read-only array
    pairs = zip(*(np.array(np.broadcast_to(part, shape)).reshape(-1, 6) for part in (found, truth)), strict=True)
    rows = []
    for one, other in pairs:
        between = Pose.from_rotvec(one[3:], one[:3]).inverse() @ Pose.from_rotvec(other[3:], other[:3])
        rows.append(np.concatenate([between.translation_m, between.rotvec_rad()]))
    return np.array(rows).reshape(shape)


def _figures(left: Array, covariance: Array | None) -> dict[str, Any]:
    lateral = np.hypot(left[..., 0], left[..., 1]) * 1e3
    turned = np.degrees(np.linalg.norm(left[..., 3:], axis=-1))
    figures: dict[str, Any] = {
        "lateral_mm_p50": np.round(np.median(lateral, axis=0), 4).tolist(),
        "lateral_mm_p95": np.round(np.percentile(lateral, 95, axis=0), 4).tolist(),
        "rotation_deg_p50": np.round(np.median(turned, axis=0), 3).tolist(),
        "rotation_deg_p95": np.round(np.percentile(turned, 95, axis=0), 3).tolist(),
    }
    if covariance is not None:
        distance = np.einsum("nki,nki->nk", left, np.linalg.solve(covariance, left[..., None])[..., 0])
        figures["truth_in_95_region"] = np.round(np.mean(distance < chi2.ppf(0.95, 6), axis=0), 3).tolist()
    return figures


def as_text(result: dict[str, Any]) -> str:
    """The result of `compare` as a table: median and p95 after each touch."""
    lines = [f"{result['trials']} histories a prior, seed {result['seed']}; network: {result['command']}"]
    for prior in PRIORS:
        lines += ["", prior, f"{'touches':>34}" + "".join(f"{count + 1:>16}" for count in range(result["touches"]))]
        before = result[prior]["no touch"]
        lines.append(
            f"  before any touch: {before['lateral_mm_p50'][0]:.2f} / {before['lateral_mm_p95'][0]:.2f} mm lateral, "
            f"{before['rotation_deg_p50'][0]:.2f} / {before['rotation_deg_p95'][0]:.2f} deg"
        )
        for way in ("sequence network", "estimator"):
            figures = result[prior][way]
            for name, label, digits in (("lateral_mm", "lateral mm", 3), ("rotation_deg", "rotation deg", 2)):
                cells = [
                    f"{p50:.{digits}f} / {p95:.{digits}f}"
                    for p50, p95 in zip(figures[f"{name}_p50"], figures[f"{name}_p95"], strict=True)
                ]
                lines.append(f"  {way:<18}{label:<14}" + "".join(f"{cell:>16}" for cell in cells))
            inside = [f"{share * 100:.0f} %" for share in figures["truth_in_95_region"]]
            lines.append(f"  {way:<18}{'in 95 % region':<14}" + "".join(f"{cell:>16}" for cell in inside))
    return "\n".join(lines)
