"""The whole assembly: calibrate if needed, run a strategy, report the pose T2; after any failure, back off."""

from __future__ import annotations

from dataclasses import dataclass

from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.holding.soundness import UNFIT
from crosspih_common.keys import ESTIMATE, SEATED
from crosspih_common.messages import (
    Assemble,
    EstimatePose,
    EstimateSeated,
    Failure,
    Phase,
    PoseErrorEstimate,
    PosePrior,
)
from services.planning.calibrating import use_calibration
from services.planning.config import PlanningConfig
from services.planning.contradiction import contradiction
from services.planning.leaving import back_off, home
from services.planning.ports import AssemblyFailed, Ports
from services.planning.run import Run
from services.planning.strategies.by_name import strategy_named
from services.planning.touching import press, relax

PRESS_ROUNDS = 3
# the peg is in: if a press or its return is stopped or refused, the peg stays, without the refined pose
STAYS_IN = (Failure.OVERLOAD, Failure.UNREACHABLE)
WELL_EXPLAINED_SIGMA = 1.6


@dataclass(frozen=True, slots=True, eq=False)
class Finished:
    """How it ended: `final` is T2 when the peg is in, else None and `failure` says why."""

    run: Run
    final: PoseErrorEstimate | None
    failure: Failure | None
    detail: str
    backed_off: bool
    insertion_depth_m: float
    warnings: tuple[str, ...] = ()


def assemble(workcell: Workcell, config: PlanningConfig, ports: Ports, request: Assemble) -> Finished:
    """Do one assembly. Never raises for what can happen to an assembly: it ends with a named failure instead.

    Raises CommandRefused before any motion: `cell_unfit` for an unfit cell, `no_strategy` for an unknown strategy.
    """
    strategy = strategy_named(request.strategy, config)
    run = Run(workcell, config, ports, request.assembly_id)
    run.hole.known = request.known
    try:
        ports.look(lambda: run.motion.dwell(0.05))
        home(run)
        use_calibration(run)
        belief = strategy(run)
        final, lost = _seated_pose(run, belief)
        depth = _depth_m(run, final.pose_base_hole.pose())
        warnings = lost + run.hole.vision_warnings + _warnings(run, final)
        run.tell(Phase.DONE, "inserted", insertion_depth_mm=depth * 1e3)
        return Finished(run, final, None, "", False, depth, warnings)
    except AssemblyFailed as error:
        failure, detail = error.failure, error.detail
    except CommandRefused as refusal:
        if refusal.code == UNFIT:
            raise
        failure, detail = Failure.REFUSED, str(refusal)
    except Exception as error:
        # a defect in a strategy must not leave the peg in the hole
        ports.report_defect(error)
        failure, detail = Failure.DEFECT, f"{type(error).__name__}: {error}"
    ports.ignore_abort()
    backed_off = back_off(run)
    run.tell(Phase.DONE, f"failed: {failure.value}: {detail}")
    return Finished(run, None, failure, detail, backed_off, 0.0)


def _warnings(run: Run, final: PoseErrorEstimate) -> tuple[str, ...]:
    """Warnings that speak against T2; none if vision was not used or gave no pose with a covariance."""
    if run.hole.vision_pose is None or not run.hole.vision_covariance:
        return ()
    said = contradiction(
        run.hole.vision_pose,
        run.hole.vision_covariance,
        final.pose_base_hole.pose(),
        final.covariance,
        run.workcell.peg.shape().outline.symmetry_order,
    )
    return () if said is None else (said,)


def _stays_in(error: AssemblyFailed) -> bool:
    """Whether the peg stays seated after this error ended the pressing: yes for all but a lost arm and an abort."""
    if error.failure is Failure.SERVICE_LOST:
        return error.lost not in ("", "hardware")
    return error.failure in STAYS_IN


def _seated_pose(run: Run, belief: PosePrior) -> tuple[PoseErrorEstimate, tuple[str, ...]]:
    """T2: the seated peg's own pose, refined to better than the clearance by presses against four walls of the bore.

    The second value are warnings, such as a service that was lost after the peg was in.
    """
    outcome, reading = relax(run)
    seated = run.ports.ask(
        SEATED,
        EstimateSeated(
            prior=belief, pose_base_peg=outcome.pose_base_peg, joints_rad=outcome.joints_rad, wrench=reading.wrench
        ),
    )
    found = seated
    if run.hole.known is not None:
        return seated, ()  # the pose is already better known than the clearance: presses would add nothing
    ended, warnings = False, list[str]()

    def end(stopped: AssemblyFailed) -> None:
        if not _stays_in(stopped):
            raise stopped
        run.tell(Phase.SEATED, f"no more pressing: {stopped.detail}")
        if stopped.failure is Failure.SERVICE_LOST:
            warnings.append(
                f"{stopped.lost} was lost once the peg was in, which stays in; T2 is what was known by then: "
                f"{stopped.detail}"
            )

    for press_round in range(PRESS_ROUNDS):
        known = len(run.presses)
        try:
            if press_round > 0:
                run.tell(Phase.SEATED, "the walls felt do not fit well: aligned with what they said, and once more")
                _align(run, found.pose_base_hole.pose())
            _press_walls(run)
        except AssemblyFailed as stopped:
            end(stopped)
            ended = True
        except CommandRefused as refusal:
            ended = True
            run.tell(Phase.SEATED, f"no more pressing: {refusal}")
        presses = tuple(run.presses[known:])
        if not presses:
            if ended:
                break
            continue
        prior = PosePrior(pose_base_hole=seated.pose_base_hole, covariance=seated.covariance)
        try:
            felt = run.ports.ask(ESTIMATE, EstimatePose(prior=prior, touches=presses))
        except AssemblyFailed as stopped:
            end(stopped)
            break
        if any(use.used for use in felt.rests_on):
            found = felt
        if ended or all(use.used and use.residual_sigma < WELL_EXPLAINED_SIGMA for use in felt.rests_on):
            break
    if found is seated and not warnings:
        run.tell(Phase.ESTIMATING, "the walls felt do not fit one pose: the seat alone counts")
    return found, tuple(warnings)


def _press_walls(run: Run) -> None:
    """Press against four walls of the bore and come back each time."""
    rest = run.motion.pose_base_peg
    run.tell(Phase.SEATED, "pressing against four walls of the bore for the exact pose")
    for direction in (rest.rotation[:, 0], rest.rotation[:, 1], -rest.rotation[:, 0], -rest.rotation[:, 1]):
        press(run, rest, direction)


def _align(run: Run, pose_base_hole: Pose) -> None:
    """Move the peg onto the hole's axis at its present depth."""
    depth_m = float((pose_base_hole.inverse() @ run.motion.pose_base_peg).translation_m[2])
    run.motion.slide_to(pose_base_hole @ Pose.from_translation([0.0, 0.0, depth_m]), run.config.press_speed_m_s)


def _depth_m(run: Run, pose_base_hole: Pose) -> float:
    shape = run.workcell.peg.shape()
    hole = run.workcell.hole.shape(shape)
    shoulder = pose_base_hole.inverse().apply(run.motion.pose_base_peg.apply([0.0, 0.0, shape.taper_start_m]))
    return float(shoulder[2]) - hole.chamfer_m
