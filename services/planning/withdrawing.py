"""A seated peg taken straight out along its own axis, under a force watch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.keys import GUARDED_MOVE
from crosspih_common.messages import Failure, GuardedMove, Phase, StopReason, Withdraw, floats
from crosspih_common.messages.motion import MAX_TRAVEL_M
from crosspih_common.wrench.plausibility import IMPLAUSIBLE
from services.planning.calibrating import report_payload
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.touching import relax

TRIES = 3  # a peg that was left askew slides once the arm has given way to it
STUCK_NM = 3.0
LET_GO_M = 0.0005
OBSERVE_S = 0.02
CREEP_M_S = 0.001
THERE_M = 2e-4


@dataclass(frozen=True, slots=True, eq=False)
class Withdrawn:
    """How it ended: `failure` is None when the peg is out; `distance_m` is how far it came."""

    run: Run
    failure: Failure | None
    detail: str
    distance_m: float


def withdraw_peg(run: Run, request: Withdraw, pose_base_hole: Pose) -> Withdrawn:
    """Out until the tip is `clear_m` before the hole's face; where that fails the peg is left where it is.

    Raises CommandRefused `cell_unfit` for a cell that is not fit to be moved, and nothing else.
    """
    run.ports.look(lambda: run.motion.dwell(0.05))
    start = run.motion.pose_base_peg.translation_m
    failure: Failure | None = None
    detail = ""
    try:
        _withdraw(run, request, pose_base_hole)
    except AssemblyFailed as error:
        failure, detail = error.failure, error.detail
    except CommandRefused as refusal:
        failure, detail = Failure.REFUSED, str(refusal)
    except Exception as error:
        run.ports.report_defect(error)
        failure, detail = Failure.DEFECT, f"{type(error).__name__}: {error}"
    distance_m = float(np.linalg.norm(run.motion.pose_base_peg.translation_m - start))
    said = "the peg is out" if failure is None else f"failed: {failure.value}: {detail}"
    run.tell(Phase.DONE, said, distance_mm=distance_m * 1e3, peak_force_n=run.counts.peak_force_n)
    return Withdrawn(run, failure, detail, distance_m)


def _withdraw(run: Run, request: Withdraw, pose_base_hole: Pose) -> None:
    calibration = run.ports.ft_calibration()
    if calibration is None or not calibration.calibrated:
        raise AssemblyFailed(
            Failure.NOT_CALIBRATED,
            "the force/torque sensor was never calibrated, so its pull cannot be watched; take the peg out by hand, "
            "then `crosspih calibrate ft`",
        )
    try:
        report_payload(run, calibration)
    except CommandRefused as refusal:
        if refusal.code != IMPLAUSIBLE:
            raise
        # A peg that presses against its bore lets nobody check a payload. The arm keeps the one it was told while the
        # peg was free, and the pull is watched with that; an arm that was told none refuses the pull by name.
        run.tell(Phase.BACKING_OFF, "the peg presses against its bore: pulled out with the payload told before")
    tip_m = run.workcell.peg.shape().tip_m
    run.tell(Phase.BACKING_OFF, "taking the peg straight out", force_limit_n=request.force_limit_n)
    for left in range(TRIES - 1, -1, -1):
        tip = pose_base_hole.inverse().apply(run.motion.pose_base_peg.apply([0.0, 0.0, tip_m]))
        travel_m = float(tip[2]) + request.clear_m
        if travel_m < THERE_M:
            return
        if travel_m > MAX_TRAVEL_M:
            raise AssemblyFailed(
                Failure.REFUSED,
                f"pose_base_hole: by it the tip is {tip[2] * 1e3:.0f} mm inside, and {request.clear_m * 1e3:.0f} mm "
                f"more are asked for; a peg is drawn {MAX_TRAVEL_M * 1e3:.0f} mm at the most: give the hole's pose "
                "as it was found",
            )
        outcome = run.ports.ask(
            GUARDED_MOVE,
            GuardedMove(
                direction_base=floats(-run.motion.pose_base_peg.rotation[:, 2]),
                speed_m_s=request.speed_m_s,
                creep_speed_m_s=min(CREEP_M_S, request.speed_m_s),
                force_threshold_n=request.force_limit_n,
                moment_threshold_nm=STUCK_NM,
                travel_limit_m=travel_m,
                observe_s=OBSERVE_S,
                retreat_m=LET_GO_M,
            ),
        )
        run.motion.account(outcome)
        if outcome.stop_reason is StopReason.TRAVEL_LIMIT:
            return
        felt = f"{outcome.stop_reason.value} after {outcome.travel_m * 1e3:.1f} mm, {outcome.peak_force_n:.1f} N"
        if outcome.stop_reason is StopReason.STOPPED:
            raise AssemblyFailed(Failure.ABORTED, felt)
        if left == 0:
            raise AssemblyFailed(Failure.STUCK, felt)
        run.tell(Phase.BACKING_OFF, f"it resists ({felt}): giving way, then once more")
        relax(run)
