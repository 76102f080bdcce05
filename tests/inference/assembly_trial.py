"""A whole assembly in the free-peg world: believe, push with admittance, and where that fails touch, estimate,
retry."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole, Peg
from services.inference.estimator import (
    EstimatorSettings,
    HolePosePrior,
    HolePosterior,
    TouchObservation,
    estimate_pose,
    final_estimate,
)
from services.inference.mechanics import PairTables
from services.inference.touch_choice.by_rule import next_touch
from tests.inference.free_peg_world import STEP_S, FreePegWorld, TouchRecord, guarded_push

READING_SD = np.repeat([0.1, 0.005], 3)
SAMPLES = 25
RIM_AHEAD_M = 0.057
VISION_SD = (2e-4, 2e-4, 6e-4, np.radians(0.6), np.radians(0.6), np.radians(0.1))


@dataclass
class PushResult:
    """How an admittance push ended: body depth past the inner rim, peaks, and where the command stood."""

    depth_m: float
    peak_force_n: float
    peak_moment_nm: float
    seconds: float
    commanded_hole_peg: Pose
    wrench_peg: Array


def admittance_push(
    world: FreePegWorld,
    start_hole_peg: Pose,
    direction_hole: Array,
    rng: np.random.Generator,
    depth_m: float = 0.015,
    speed_m_s: float = 0.01,
    force_limit_n: float = 25.0,
    moment_limit_nm: float = 2.5,
    timeout_s: float = 12.0,
) -> PushResult:
    """Advance along a direction, giving way sideways (2 N/(mm/s)) and in rotation (20 Nm/(rad/s)) about the rim."""
    peg, hole = world.peg, world.hole
    assert isinstance(peg, Peg) and isinstance(hole, Hole)
    world.place(start_hole_peg)
    rotation, position = start_hole_peg.rotation.copy(), start_hole_peg.translation_m.copy()
    lever = np.array([0.0, 0.0, RIM_AHEAD_M])
    felt = np.zeros(6)
    twist = np.zeros(6)
    peak_force = peak_moment = 0.0
    best_z, best_at = -np.inf, 0
    steps = int(timeout_s / STEP_S)
    for count in range(steps):
        wrist = world.step(Pose(rotation, position), twist)
        # Contact wrench on the peg is what the wrist holds against; sensor noise, then a filter of 100 Hz.
        reading = -wrist + rng.normal(size=6) * READING_SD
        felt += 0.47 * (reading - felt)
        force, moment = felt[:3], felt[3:]
        peak_force = max(peak_force, float(np.linalg.norm(wrist[:3])))
        peak_moment = max(peak_moment, float(np.linalg.norm(wrist[3:])))
        along = rotation.T @ direction_hole
        lateral = force - along * (force @ along)
        give = lateral / 2000.0
        give *= min(1.0, 0.003 / max(float(np.linalg.norm(give)), 1e-12))
        turn = (moment - np.cross(lever, force)) / 20.0
        turn *= min(1.0, 0.05 / max(float(np.linalg.norm(turn)), 1e-12))
        resisting = max(0.0, -float(force @ along))
        forward = speed_m_s * max(0.0, 1.0 - resisting / 12.0)
        # The turn is about the rim: the F/T origin moves with it.
        velocity_peg = give + forward * along - np.cross(turn, lever)
        twist = np.concatenate([rotation @ velocity_peg, rotation @ turn])
        position = position + twist[:3] * STEP_S
        rotation = Rotation.from_rotvec(twist[3:] * STEP_S).as_matrix() @ rotation
        if count % 20 == 0:
            rotation = np.asarray(Rotation.from_matrix(rotation).as_matrix())
            pose = world.pose_hole_peg()
            depth = float(pose.apply([0.0, 0.0, peg.taper_start_m])[2]) - hole.chamfer_m
            if depth > best_z + 1e-4:
                best_z, best_at = depth, count
            stuck = count - best_at > 1500
            if depth >= depth_m or stuck:
                break
        if np.linalg.norm(force) > force_limit_n or np.linalg.norm(moment) > moment_limit_nm:
            break
    pose = world.pose_hole_peg()
    depth = float(pose.apply([0.0, 0.0, peg.taper_start_m])[2]) - hole.chamfer_m
    return PushResult(depth, peak_force, peak_moment, count * STEP_S, Pose(rotation, position), felt.copy())


def observe(
    record: TouchRecord, pose_base_hole: Pose, direction_base: Array, compliance: Array, rng: np.random.Generator
) -> TouchObservation:
    """A touch as the sensors would tell it: base frame, noise of 25 averaged readings."""
    sd = READING_SD / np.sqrt(SAMPLES)
    wrench = record.wrench_peg + rng.normal(size=6) * sd
    informative = bool(np.linalg.norm(record.wrench_peg[:3]) > 5.0)
    return TouchObservation(
        pose_base_hole @ record.commanded_hole_peg, wrench, sd, compliance, direction_base, informative
    )


@dataclass
class Trial:
    """What became of one assembly."""

    inserted: bool
    corrections: int
    touches: int
    error: Pose
    peak_force_n: float
    peak_moment_nm: float
    motion_s: float
    touch_error: Pose | None = None
    log: list[str] = field(default_factory=list)


def assemble(
    peg: Peg,
    hole: Hole,
    friction_coefficient: float,
    seed: int,
    prior_sd: tuple[float, ...] = VISION_SD,
    touches_a_correction: int = 2,
    most_corrections: int = 6,
    push_first: bool = True,
    settings: EstimatorSettings | None = None,
    model_peg: Peg | None = None,
    model_hole: Hole | None = None,
    compliance_scale: float = 1.0,
) -> Trial:
    """One assembly from a belief drawn off the truth with `prior_sd`; the models, and the
    believed compliance, may differ from the real ones."""
    rng = np.random.default_rng(seed)
    world = FreePegWorld(peg, hole, friction_coefficient)
    known_peg, known_hole = model_peg or peg, model_hole or hole
    tables = PairTables.of(known_peg, known_hole)
    compliance = world.compliance_peg * compliance_scale
    error = rng.normal(size=6) * prior_sd
    truth = Pose.from_rotvec(rng.uniform(-3, 3, 3), rng.uniform(-1, 1, 3))
    believed = truth @ Pose.from_rotvec(error[3:], error[:3])
    prior = HolePosePrior(believed, np.diag(np.square(prior_sd)))
    estimate: HolePosterior | None = None
    covariance = prior.covariance
    observations: list[TouchObservation] = []
    log: list[str] = []
    peak_force = peak_moment = seconds = 0.0
    to_hole = truth.inverse()
    failed = corrections = 0
    used = True
    result: PushResult | None = None
    while corrections <= most_corrections:
        if push_first or observations:
            start = believed @ Pose.from_translation([0.0, 0.0, -0.002 - peg.tip_m])
            direction = believed.rotation[:, 2]
            result = admittance_push(world, to_hole @ start, to_hole.rotate(direction), rng)
            peak_force = max(peak_force, result.peak_force_n)
            peak_moment = max(peak_moment, result.peak_moment_nm)
            seconds += result.seconds
            log.append(f"push depth {result.depth_m * 1e3:.1f} mm, {result.seconds:.1f} s")
            if result.depth_m >= 0.015:
                break
            failed += 1
        corrections += 1
        for _ in range(touches_a_correction):
            plan = next_touch(known_peg, believed, covariance, failed, len(observations), used)
            record = guarded_push(world, to_hole @ plan.pose_base_peg_start, to_hole.rotate(plan.direction_base), 0.05)
            seconds += record.travelled_m / 0.004
            peak_force = max(peak_force, record.reached_n)
            observations.append(observe(record, truth, plan.direction_base, compliance, rng))
            estimate = estimate_pose(
                tables, prior, observations, np.random.default_rng(seed), settings, previous=estimate
            )
            believed, covariance = estimate.pose_base_hole, estimate.covariance
            left = to_hole @ believed
            verdict = estimate.touches[-1]
            used = verdict.used
            log.append(
                f"{plan.idea}: {record.contacts} contacts, used {verdict.used}, cost {verdict.cost:.1f} "
                f"({len(verdict.contacts)}), error {np.round(left.translation_m * 1e3, 3)} mm "
                f"{np.round(np.degrees(left.rotvec_rad()), 2)} deg, mu {estimate.friction_coefficient:.3f}"
            )
    touch_error = to_hole @ believed if estimate is not None else None
    inserted = result is not None and result.depth_m >= 0.015
    if inserted and result is not None:
        believed, covariance = final_estimate(
            known_peg, known_hole, believed, covariance, truth @ result.commanded_hole_peg, result.wrench_peg,
            compliance,
        )  # fmt: skip
    world.close()
    return Trial(
        inserted, corrections, len(observations), to_hole @ believed, peak_force, peak_moment, seconds, touch_error, log
    )
