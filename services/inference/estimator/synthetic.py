"""Simulated touches with several contacts and a compliant wrist, for measuring the coverage.

A push continues past its first contact as the guarded move does. The peg rests where its wrist's deflection and the
contact forces balance: f >= 0, gap >= 0, f gap = 0 for the first contact of every pair of pieces, a linear
complementarity problem in each Newton step (Stewart and Trinkle 1996), solved by projected Gauss-Seidel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.inference.estimator.observation import TouchObservation
from services.inference.mechanics import PairTables, contact_geometry, contact_wrench_basis, first_contacts

NEWTON_STEPS = 4
SWEEPS = 60
PRESSING_N = 0.05
BISECTIONS = 5
LARGEST_BEND_M = 0.005


@dataclass(frozen=True, slots=True)
class TouchNoise:
    """The differences of a synthetic touch from the model: a reading's sd (N, Nm, after averaging), an error of the
    pose of each touch (m, rad) about a point `about_m` along the peg, and one of the wrench as a share of its size.

    Defaults: 25 samples of 0.1 N and 0.005 Nm; 0.03 mm and 0.2 mrad for an arm with a repeatability of 0.02 mm; 0.5 %
    of the wrench in a random direction, for friction that deviates from Coulomb's law.
    """

    force_n: float = 0.02
    moment_nm: float = 0.001
    position_m: float = 3e-5
    rotation_rad: float = 2e-4
    wrench_share: float = 0.005
    about_m: float = 0.06


@dataclass(frozen=True, slots=True)
class GuardedPush:
    """The end of a push: the force or moment that stops it, and the creep past it during the averaging."""

    force_n: float = 5.0
    moment_nm: float = 1.0
    creep_m: float = 8e-5
    limit_m: float = 0.045


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticTouch:
    """The observation, and the number of contacts that carried force."""

    observation: TouchObservation
    contacts: int


def touch(
    tables: PairTables,
    pose_base_hole: Pose,
    pose_base_peg_start: Pose,
    direction_base: Array,
    compliance_peg: Array,
    friction: float,
    rng: np.random.Generator,
    noise: TouchNoise | None = None,
    push: GuardedPush | None = None,
) -> SyntheticTouch | None:
    """A push along a unit direction from a start in free air; None if it meets nothing within its limit, or nothing
    that stops it."""
    noise, push = noise or TouchNoise(), push or GuardedPush()
    into = pose_base_hole.inverse()
    start, direction = into @ pose_base_peg_start, into.rotate(direction_base)
    travel = float(
        first_contacts(tables, start.rotation[None], start.translation_m[None], direction[None]).travel_m.min()
    )
    if not -0.001 < travel < push.limit_m:
        return None

    def pushed(past_m: float) -> tuple[Pose, Array, int]:
        at = Pose(start.rotation, start.translation_m + (travel + past_m) * direction)
        return at, *settle(tables, at, direction, compliance_peg, friction)

    def reached(past_m: float) -> float:
        _, felt, _ = pushed(past_m)
        return max(float(np.linalg.norm(felt[:3])) / push.force_n, float(np.linalg.norm(felt[3:])) / push.moment_nm)

    low, high = 0.0, 1e-4
    while reached(high) < 1.0:
        low, high = high, 2.0 * high
        if high > LARGEST_BEND_M:
            return None
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reached(middle) >= 1.0 else (middle, high)
    commanded, wrench, contacts = pushed(high + push.creep_m)
    sd = np.repeat([noise.force_n, noise.moment_nm], 3)
    wild = rng.normal(size=6) * np.repeat([np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:])], 3)
    measured = wrench + rng.normal(size=6) * sd + noise.wrench_share * wild
    slip = rng.normal(size=6) * np.repeat([noise.position_m, noise.rotation_rad], 3)
    seen = pose_base_hole @ commanded @ _about(noise.about_m, slip)
    return SyntheticTouch(TouchObservation(seen, measured, sd, compliance_peg, np.asarray(direction_base)), contacts)


def settle(
    tables: PairTables, commanded_hole_peg: Pose, direction_hole: Array, compliance_peg: Array, friction: float
) -> tuple[Array, int]:
    """The contact wrench (6,) on the peg, peg frame, for a peg commanded to a pose, and the number of contacts."""
    twist = np.zeros(6)
    force = np.zeros(0)
    wrench = np.zeros(6)
    for _ in range(NEWTON_STEPS):
        pose = commanded_hole_peg @ Pose.from_rotvec(twist[3:], twist[:3])
        pairs = first_contacts(tables, pose.rotation[None], pose.translation_m[None], direction_hole[None])
        near = np.flatnonzero(np.isfinite(pairs.travel_m[0]) & (np.abs(pairs.travel_m[0]) < 0.004))
        if not len(near):
            return np.zeros(6), 0
        geometry = contact_geometry(pairs.features[0, near], pose.rotation, pose.translation_m)
        basis = contact_wrench_basis(
            geometry.normal_peg, geometry.point_peg_m, pose.rotation.T @ direction_hole, friction, compliance_peg
        )
        normal = np.column_stack([geometry.normal_peg, np.cross(geometry.point_peg_m, geometry.normal_peg)])
        matrix = normal @ compliance_peg @ basis.T
        force = complementarity(matrix, geometry.gap_m - normal @ twist)
        wrench = basis.T @ force
        twist = compliance_peg @ wrench
    return wrench, int(np.count_nonzero(force > PRESSING_N))


def complementarity(matrix: Array, offset: Array) -> Array:
    """Forces f >= 0 with matrix f + offset >= 0 and zero product, by projected Gauss-Seidel (Cottle et al. 1992)."""
    force = np.zeros(len(offset))
    diagonal = np.maximum(np.diag(matrix), 1e-12)
    for _ in range(SWEEPS):
        for row in range(len(offset)):
            force[row] = max(0.0, force[row] - (matrix[row] @ force + offset[row]) / diagonal[row])
    return force


def _about(height_m: float, slip: Array) -> Pose:
    """A small error (6,) of the peg's pose as a motion about a point on its axis."""
    middle = Pose.from_translation([0.0, 0.0, height_m])
    return middle @ Pose.from_rotvec(slip[3:], slip[:3]) @ middle.inverse()
