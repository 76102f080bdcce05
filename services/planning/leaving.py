"""Withdrawing from the hole and moving home: the peg always leaves along its own axis."""

from __future__ import annotations

import numpy as np

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.messages import Failure, Phase
from services.planning.ports import AssemblyFailed
from services.planning.run import Run

AT_HOME_RAD = 0.02
BACK_OFF_TRIES = 3  # a wedged peg may be stopped by the cell's caps on its way out
NEAR_HOLE_M = 0.06  # from the axis of the nominal hole: half the cross, the hole's range, and a margin


def withdraw(run: Run, pose_base_hole: Pose, distance_m: float) -> float:
    """Back along the peg's own axis until the tip is that far before the face; how far before it is, m.

    A push leaves the peg askew in the hole, and any other way out would press it against the walls.
    """
    tip_m = run.workcell.peg.shape().tip_m

    def before_m() -> float:
        return -float(pose_base_hole.inverse().apply(run.motion.pose_base_peg.apply([0.0, 0.0, tip_m]))[2])

    if before_m() < distance_m:
        run.motion.slide_to(run.motion.pose_base_peg @ Pose.from_translation([0.0, 0.0, before_m() - distance_m]))
    return before_m()


def home(run: Run) -> None:
    """Move home from any pose in which the last assembly left the arm; a peg in the hole is taken out first."""
    home = np.asarray(run.workcell.home_joints_rad, dtype=float)
    if np.abs(run.motion.joints_rad - home).max() < AT_HOME_RAD:
        return
    nominal = run.workcell.hole_prior.pose_base_hole()
    x, y, z = nominal.inverse().apply(run.motion.pose_base_peg.apply([0.0, 0.0, run.workcell.peg.shape().tip_m]))
    in_zone = np.hypot(x, y) < NEAR_HOLE_M and z > -run.config.approach_m
    if in_zone and z > 0.0:
        run.ports.publish_event(
            "peg_found", f"the peg's tip is {z * 1e3:.0f} mm past the hole's face as drawn: taken out"
        )
    if in_zone and not back_off(run):
        raise AssemblyFailed(Failure.UNREACHABLE, "the arm is not at home, and the peg cannot be taken out")
    run.motion.line_to(run.motion.collisions.before_zone(run.motion.pose_base_peg))
    run.motion.joints_to(home)


def back_off(run: Run) -> bool:
    """Move out of the hole along the peg's own axis, clear of the face. True if that succeeded."""
    run.tell(Phase.BACKING_OFF, "taking the peg out")
    # clear of the estimated and of the nominal hole, whichever is nearer
    aims = [run.workcell.hole_prior.pose_base_hole(), *([] if run.hole.believed is None else [run.hole.believed])]
    # After a lost link the outcome of the last command is unknown. The arm has stopped by itself, and each step here
    # leads to a stated pose, so it can safely be requested again.
    mended: dict[Failure | None, int] = {Failure.ARM_STOPPED: BACK_OFF_TRIES, Failure.SERVICE_LOST: 1}
    for _ in range(BACK_OFF_TRIES):
        try:
            run.motion.dwell(0.02)
            if all([withdraw(run, aim, run.config.approach_m) >= run.config.approach_m - 0.005 for aim in aims]):
                return True
        except (AssemblyFailed, CommandRefused) as error:
            run.tell(Phase.BACKING_OFF, f"could not back off: {error}")
            if isinstance(error, CommandRefused) or mended.get(error.failure, 0) == 0:
                return False
            mended[error.failure] -= 1
        except Exception as error:
            run.ports.report_defect(error)
            return False
    return False
