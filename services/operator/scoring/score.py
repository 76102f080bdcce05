"""How well an assembly did, against the simulator's truth. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy.spatial.transform import Rotation

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import AssemblyResult, PosePrior, SimulationTruth
from services.operator.scoring.challenge_score import challenge_score

# a seated peg is off the axis by its clearance at most; one that is off by more than this is deep, but not in the hole
MIN_BESIDE_M = 0.002
SWITCHED_OFF = "switched_off"  # vision's refusal in a cell whose file has it disabled: no picture was taken


@dataclass(frozen=True, slots=True)
class PoseError:
    """A pose of the hole against the true one: across the true axis, along it, whole rotation, and tilt of the axis."""

    lateral_mm: float
    depth_mm: float
    rotation_deg: float
    tilt_deg: float


def pose_error(estimate_base_hole: Pose, true_base_hole: Pose, symmetry_order: int = 4) -> PoseError:
    """The error in the true hole's frame. Rotations about the axis that map the section onto itself do not count:
    quarter turns for the cross, none for a keyed round (1), any for a round (0).
    """
    error = true_base_hole.inverse() @ estimate_base_hole
    if symmetry_order == 0:
        # the smallest rotation that maps one axis onto the other
        angles = np.arccos(np.clip(error.rotation[2, 2], -1.0, 1.0))
    else:
        turns = np.arange(symmetry_order) * (2.0 * np.pi / symmetry_order)
        same = Rotation.from_rotvec(np.outer(turns, [0.0, 0.0, 1.0]))
        angles = (Rotation.from_matrix(error.rotation) * same).magnitude()
    return PoseError(
        lateral_mm=float(np.hypot(error.translation_m[0], error.translation_m[1])) * 1e3,
        depth_mm=float(error.translation_m[2]) * 1e3,
        rotation_deg=float(np.rad2deg(np.min(angles))),
        tilt_deg=float(np.rad2deg(np.arccos(np.clip(error.rotation[2, 2], -1.0, 1.0)))),
    )


def insertion_depth_m(workcell: Workcell, pose_base_peg: Pose, pose_base_hole: Pose) -> float:
    """How far the peg's body is past the inner rim; negative while it is still outside."""
    peg = workcell.peg.shape()
    hole = workcell.hole.shape(peg)
    shoulder = pose_base_hole.inverse().apply(pose_base_peg.apply([0.0, 0.0, peg.taper_start_m]))
    return float(shoulder[2]) - hole.chamfer_m


def beside_m(workcell: Workcell, pose_base_peg: Pose, pose_base_hole: Pose) -> float:
    """The distance of the peg's shoulder from the hole's axis."""
    shoulder = pose_base_hole.inverse().apply(pose_base_peg.apply([0.0, 0.0, workcell.peg.shape().taper_start_m]))
    return float(np.hypot(shoulder[0], shoulder[1]))


def start_distance_m(workcell: Workcell, pose_base_hole: Pose) -> float:
    """From the peg's tip at the home position to the hole."""
    tip = workcell.pose_base_peg(workcell.home_joints_rad).apply([0.0, 0.0, workcell.peg.shape().tip_m])
    return float(np.linalg.norm(tip - pose_base_hole.translation_m))


class TrialFigures(BaseModel):
    """What `crosspih assemble --json` prints. Errors are None where there is no truth or no pose to score."""

    model_config = ConfigDict(frozen=True)

    seed: int | None
    strategy: str
    inserted: bool
    failure: str | None
    failure_detail: str
    backed_off: bool
    motion_s: float
    thinking_s: float
    duration_s: float
    wall_s: float
    touches: int
    presses: int
    corrections: int
    pushes: int
    peak_force_n: float
    peak_moment_nm: float
    # None where the driver does not report it, and the score where there is no truth
    mean_force_n: float | None = None
    over_20_n_s: float | None = None
    tip_path_m: float | None = None
    mean_jerk_m_s3: float | None = None
    challenge_score: float | None = None
    # vision was asked, in a cell that has it enabled; the code of its refusal, empty where it saw the hole or was not
    # asked; whether the hole was found by force alone though vision was asked
    looked: bool = False
    vision_refused: str = ""
    felt_for: bool = False
    vision_error_mm: float | None
    vision_error_deg: float | None
    vision_tilt_deg: float | None
    vision_depth_mm: float | None
    final_error_mm: float | None
    final_error_deg: float | None
    final_depth_mm: float | None
    insertion_depth_mm: float | None
    rank: int | None = None  # directions that the bore's walls fix, of five: all but along the axis
    warnings: tuple[str, ...] = ()  # reasons to doubt T2 although the peg is in
    found: PosePrior | None = None  # T2 with its covariance, for the assembly of another peg in that hole
    recording: str | None  # its first file
    report: str | None
    recording_parts: tuple[str, ...] = ()  # all its files
    recording_warnings: tuple[str, ...] = ()  # what is missing from it


def score(
    workcell: Workcell, result: AssemblyResult, truth: SimulationTruth | None, *, wall_s: float, recording: str | None
) -> TrialFigures:
    """The figures of a trial. With a truth the peg counts as inserted only if it really is."""
    vision = final = depth_m = None
    inserted, failure = result.inserted, result.failure.value if result.failure else None
    if truth is not None:
        true_hole = truth.pose_base_hole.pose()
        order = workcell.peg.shape().outline.symmetry_order
        if result.vision_pose_base_hole is not None:
            vision = pose_error(result.vision_pose_base_hole.pose(), true_hole, order)
        if result.inserted and result.pose_base_hole is not None:
            final = pose_error(result.pose_base_hole.pose(), true_hole, order)
        depth_m = insertion_depth_m(workcell, truth.pose_base_peg.pose(), true_hole)
        if inserted and beside_m(workcell, truth.pose_base_peg.pose(), true_hole) > MIN_BESIDE_M:
            inserted, failure = False, "beside_the_hole"
        elif inserted and depth_m < workcell.insertion_depth_m:
            inserted, failure = False, "not_deep_enough"
    elif result.inserted:
        depth_m = result.insertion_depth_m
    # a driver that reports nothing about its motions reports that the tip never moved
    told = result.tip_path_m > 0.0
    refused = result.vision_refused.partition(":")[0]
    mean_jerk_m_s3 = result.jerk_integral_m_s2 / result.moving_s if result.moving_s > 0.0 else 0.0
    duration_s = round(result.motion_s + result.thinking_s, 4)
    points = None
    if told and truth is not None:
        points = challenge_score(
            inserted=inserted,
            failure=failure,
            duration_s=duration_s,
            mean_jerk_m_s3=mean_jerk_m_s3,
            tip_path_m=result.tip_path_m,
            start_distance_m=start_distance_m(workcell, truth.pose_base_hole.pose()),
            over_20_n_s=result.over_20_n_s,
        ).total
    return TrialFigures(
        seed=None if truth is None else truth.seed,
        strategy=result.strategy.value,
        inserted=inserted,
        failure=failure,
        failure_detail=result.failure_detail,
        backed_off=result.backed_off,
        motion_s=round(result.motion_s, 6),
        thinking_s=round(result.thinking_s, 4),
        duration_s=duration_s,
        wall_s=round(wall_s, 3),
        touches=result.touches,
        presses=result.presses,
        corrections=result.corrections,
        pushes=result.pushes,
        peak_force_n=result.peak_force_n,
        peak_moment_nm=result.peak_moment_nm,
        mean_force_n=result.contact_impulse_n_s / result.contact_s if result.contact_s > 0.0 else None,
        over_20_n_s=result.over_20_n_s if told else None,
        tip_path_m=result.tip_path_m if told else None,
        mean_jerk_m_s3=mean_jerk_m_s3 if told else None,
        challenge_score=points,
        looked=result.vision_pose_base_hole is not None or refused not in ("", SWITCHED_OFF),
        vision_refused=refused,
        felt_for=result.felt_for,
        vision_error_mm=None if vision is None else vision.lateral_mm,
        vision_error_deg=None if vision is None else vision.rotation_deg,
        vision_tilt_deg=None if vision is None else vision.tilt_deg,
        vision_depth_mm=None if vision is None else vision.depth_mm,
        final_error_mm=None if final is None else final.lateral_mm,
        final_error_deg=None if final is None else final.rotation_deg,
        final_depth_mm=None if final is None else final.depth_mm,
        insertion_depth_mm=None if depth_m is None else depth_m * 1e3,
        rank=result.rank,
        warnings=result.warnings,
        found=_found(result) if inserted else None,
        recording=recording,
        report=None,
    )


def seen_in_words(figures: TrialFigures) -> str:
    """The part of vision in a trial, in a few words."""
    if figures.vision_refused:
        return f"refused ({figures.vision_refused})" + (", found by force" if figures.felt_for else "")
    if not figures.looked:
        return "not asked"
    return "saw it, forgotten for force" if figures.felt_for else "saw it"


def _found(result: AssemblyResult) -> PosePrior | None:
    if result.pose_base_hole is None or result.covariance is None:
        return None
    return PosePrior(pose_base_hole=result.pose_base_hole, covariance=result.covariance)
