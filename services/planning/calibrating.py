"""The force/torque sensor's calibration: drive poses, identify the payload, report it to the arm."""

from __future__ import annotations

import numpy as np

from crosspih_common.errors import CommandRefused
from crosspih_common.keys import IDENTIFY_PAYLOAD, SET_PAYLOAD
from crosspih_common.messages import Failure, FtCalibration, IdentifyPayload, Phase, RawReading, SetPayload
from services.planning.calibration_poses import CalibrationPosesError, choose_calibration_poses
from services.planning.ports import AssemblyFailed
from services.planning.run import Run


def calibrate(run: Run, dwell_s: float, temperature_c: float | None = None) -> FtCalibration:
    """Drive the calibration poses, dwell in each, identify bias and payload.

    Raises AssemblyFailed UNREACHABLE if there are no such poses, or no collision-free path to them.
    """
    readings = []
    try:
        poses = choose_calibration_poses(run.motion.arm, run.workcell.home_joints_rad, run.motion.collisions)
    except CalibrationPosesError as error:
        raise AssemblyFailed(Failure.UNREACHABLE, f"no poses to calibrate in: {error}") from None
    for index, joints in enumerate(poses):
        run.tell(Phase.CALIBRATING, f"sensor pose {index + 1} of {len(poses)}")
        run.motion.joints_to(np.asarray(joints, dtype=float))
        run.motion.dwell(0.1)  # let the arm settle
        outcome = run.motion.dwell(dwell_s)
        readings.append(
            RawReading(pose_base_peg=outcome.pose_base_peg, wrench_raw=outcome.wrench_raw, wrench_sd=outcome.wrench_sd)
        )
    run.motion.joints_to(np.asarray(run.workcell.home_joints_rad, dtype=float))
    try:
        found = run.ports.ask(IDENTIFY_PAYLOAD, IdentifyPayload(readings=tuple(readings), temperature_c=temperature_c))
    except CommandRefused as refusal:
        raise AssemblyFailed(Failure.NOT_CALIBRATED, str(refusal)) from None
    run.tell(
        Phase.CALIBRATING,
        f"weight {found.weight_n:.3f} N, residual {found.residual_force_n:.3f} N",
        weight_n=found.weight_n,
        residual_force_n=found.residual_force_n,
        residual_moment_nm=found.residual_moment_nm,
    )
    return found


def use_calibration(run: Run) -> None:
    """Calibrate the sensor if it never was, and report its payload to the arm."""
    calibration = run.ports.ft_calibration()
    if calibration is None or not calibration.calibrated:
        run.tell(Phase.CALIBRATING, "the force/torque sensor was never calibrated: doing it now")
        calibration = calibrate(run, run.config.calibration_dwell_s)
    report_payload(run, calibration)


def report_payload(run: Run, calibration: FtCalibration) -> None:
    """Report the payload to the arm; forces measured before that no longer count."""
    run.ports.ask(
        SET_PAYLOAD,
        SetPayload(
            bias=calibration.bias,
            weight_n=calibration.weight_n,
            centroid_ft_m=calibration.centroid_m,
            gravity_base=calibration.gravity_base,
        ),
    )
    run.counts.forget_forces()
