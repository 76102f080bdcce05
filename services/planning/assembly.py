"""The assembly as a whole: calibrate if needed, run a strategy, report the pose T2; whatever fails, back off."""

from __future__ import annotations

from dataclasses import dataclass

from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.keys import COMPENSATE, ESTIMATE, SEATED
from crosspih_common.messages import (
    Assemble,
    CompensateWrench,
    EstimatePose,
    EstimateSeated,
    Failure,
    Phase,
    PoseErrorEstimate,
    PosePrior,
)
from services.planning.config import PlanningConfig
from services.planning.ports import AssemblyFailed, Ports
from services.planning.run import Run
from services.planning.strategies import STRATEGIES


@dataclass(frozen=True, slots=True, eq=False)
class Finished:
    """How it ended: `final` is T2 when the peg is in, else None and `failure` says why."""

    run: Run
    final: PoseErrorEstimate | None
    failure: Failure | None
    detail: str
    backed_off: bool
    insertion_depth_m: float


def assemble(workcell: Workcell, config: PlanningConfig, ports: Ports, request: Assemble) -> Finished:
    """Do one assembly. Never raises for what can happen to an assembly: it ends with a named failure instead."""
    run = Run(workcell, config, ports, request.assembly_id)
    try:
        run.dwell(0.05)
        run.use_calibration()
        belief = STRATEGIES[request.strategy](run)
        final = _seated_pose(run, belief)
        depth = _depth_m(run, final.pose_base_hole.pose())
        run.tell(Phase.DONE, "inserted", insertion_depth_mm=depth * 1e3)
        return Finished(run, final, None, "", False, depth)
    except AssemblyFailed as error:
        failure, detail = error.failure, error.detail
    except CommandRefused as refusal:
        failure, detail = Failure.REFUSED, str(refusal)
    ports.ignore_abort()
    backed_off = run.back_off()
    run.tell(Phase.DONE, f"failed: {failure.value}: {detail}")
    return Finished(run, None, failure, detail, backed_off, 0.0)


def _seated_pose(run: Run, belief: PosePrior) -> PoseErrorEstimate:
    """T2: the seated peg's own pose, then better than the clearance by pressing against four walls of the bore."""
    outcome = run.dwell(0.1)
    reading = run.ports.ask(
        COMPENSATE,
        CompensateWrench(
            pose_base_peg=outcome.pose_base_peg, wrench_raw=outcome.wrench_raw, wrench_sd=outcome.wrench_sd
        ),
    )
    seated = run.ports.ask(
        SEATED,
        EstimateSeated(
            prior=belief, pose_base_peg=outcome.pose_base_peg, joints_rad=outcome.joints_rad, wrench=reading.wrench
        ),
    )
    rest = run.pose_base_peg
    run.tell(Phase.SEATED, "pressing against four walls of the bore for the exact pose")
    for direction in (rest.rotation[:, 0], rest.rotation[:, 1], -rest.rotation[:, 0], -rest.rotation[:, 1]):
        run.press(rest, direction)
    if not run.presses:
        return seated
    prior = PosePrior(pose_base_hole=seated.pose_base_hole, covariance=seated.covariance)
    felt_pose = run.ports.ask(ESTIMATE, EstimatePose(prior=prior, touches=tuple(run.presses)))
    if not any(use.used for use in felt_pose.rests_on):
        run.tell(Phase.ESTIMATING, "the walls felt do not fit one pose: the seat alone counts")
        return seated
    return felt_pose


def _depth_m(run: Run, pose_base_hole: Pose) -> float:
    shape = run.workcell.peg.shape()
    hole = run.workcell.hole.shape(shape)
    shoulder = pose_base_hole.inverse().apply(run.pose_base_peg.apply([0.0, 0.0, shape.taper_start_m]))
    return float(shoulder[2]) - hole.chamfer_m
