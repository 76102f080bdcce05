"""Makes the result message of an assembly."""

from __future__ import annotations

import dataclasses

from crosspih_common.messages import Assemble, AssemblyResult, PoseData
from services.planning.assembly import Finished


def result_of(request: Assemble, done: Finished, thinking_s: float) -> AssemblyResult:
    """The message; `thinking_s` is the wall time in which the arm had nothing to do."""
    run, final = done.run, done.final
    believed = final.pose_base_hole if final is not None else None
    if believed is None and run.hole.believed is not None:
        believed = PoseData.of(run.hole.believed)
    return AssemblyResult(
        assembly_id=request.assembly_id,
        strategy=request.strategy,
        inserted=final is not None,
        failure=done.failure,
        failure_detail=done.detail,
        backed_off=done.backed_off,
        pose_base_hole=believed,
        covariance=None if final is None else final.covariance,
        rank=None if final is None else final.rank,
        pose_base_peg=PoseData.of(run.motion.pose_base_peg),
        warnings=done.warnings,
        vision_refused=run.hole.vision_refused,
        felt_for=run.hole.felt_for,
        vision_pose_base_hole=None if run.hole.vision_pose is None else PoseData.of(run.hole.vision_pose),
        motion_s=run.counts.motion_s,
        thinking_s=thinking_s,
        touches=len(run.touches),
        presses=len(run.presses),
        corrections=run.counts.corrections,
        pushes=run.counts.pushes,
        peak_force_n=run.counts.peak_force_n,
        peak_moment_nm=run.counts.peak_moment_nm,
        insertion_depth_m=done.insertion_depth_m,
        **dataclasses.asdict(run.counts.effort),
    )
