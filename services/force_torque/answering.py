"""The service's answers, which depend on the request and the calibration alone."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timezone

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.messages import (
    ClassifyContacts,
    CompensateWrench,
    ContactReading,
    ContactStates,
    FtCalibration,
    IdentifyPayload,
    floats,
)
from crosspih_common.wrench import IMPLAUSIBLE, Payload, judge_bounds, refuse_implausible_wrench
from services.force_torque.against_drawing import judge_centroid
from services.force_torque.calibration import (
    CalibrationError,
    CalibrationLimits,
    MountingTurned,
    StaticReading,
    calibrate,
)
from services.force_torque.calibration_file import CalibrationFile, calibration_file
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.judging import Judge


def compensated(payload: Payload, judge: Judge, command: CompensateWrench) -> ContactReading:
    """The contact part of one averaged reading, and its contact state. Raises CommandRefused `implausible`."""
    sd = payload.mounting.peg_sd(command.wrench_sd)
    wrench = payload.contact(command.wrench_raw, command.pose_base_peg.pose().rotation)
    residual = None
    if command.wrench_free_raw is not None:
        free = (command.pose_base_peg_free or command.pose_base_peg).pose().rotation
        residual = payload.contact(command.wrench_free_raw, free)
        wrench = wrench - residual
    refuse_implausible_wrench(wrench, "wrench_raw, as the contact that it is")
    refuse_implausible_wrench(sd, "wrench_sd, on the peg")
    return ContactReading(
        wrench=floats(wrench),
        wrench_sd=floats(sd),
        free_residual=None if residual is None else floats(residual),
        state=judge(wrench, sd),
    )


def classified(judge: Judge, command: ClassifyContacts) -> ContactStates:
    """The states of wrenches. Raises CommandRefused: lengths, implausible."""
    if len(command.wrench_sds) != len(command.wrenches):
        raise CommandRefused(
            "lengths",
            f"{len(command.wrenches)} wrenches with {len(command.wrench_sds)} wrench_sds; want one for each",
        )
    for index, (wrench, sd) in enumerate(zip(command.wrenches, command.wrench_sds, strict=True)):
        refuse_implausible_wrench(wrench, f"wrenches.{index}")
        refuse_implausible_wrench(sd, f"wrench_sds.{index}")
    pairs = zip(command.wrenches, command.wrench_sds, strict=True)
    return ContactStates(
        states=tuple(judge(np.asarray(wrench), np.asarray(sd), command.classifier) for wrench, sd in pairs)
    )


def identified(
    workcell: Workcell, config: ForceTorqueConfig, command: IdentifyPayload
) -> tuple[CalibrationFile, Payload]:
    """Bias, weight and centroid from dwells. Raises CommandRefused: calibration, implausible_payload."""
    mounting = workcell.sensor_mounting()
    readings = [
        StaticReading(
            mounting.rotation_base_sensor(reading.pose_base_peg.pose().rotation),
            mounting.sensor(reading.wrench_raw),
            mounting.sensor_sd(reading.wrench_sd),
        )
        for reading in command.readings
    ]
    try:
        found = calibrate(readings, gravity_free=config.gravity_free, limits=_limits(workcell, config))
    except MountingTurned as error:
        raise CommandRefused("calibration", f"{error}: {_mend(workcell, error)}") from None
    except CalibrationError as error:
        raise CommandRefused("calibration", str(error)) from None
    payload = replace(found.payload, mounting=mounting)
    peg = workcell.peg.shape()
    refusal = judge_bounds(payload, workcell.payload_limits()) or judge_centroid(payload, peg)
    if refusal is not None:
        raise CommandRefused(IMPLAUSIBLE, refusal)
    content = calibration_file(
        found,
        [readings[index] for index in found.poses],
        calibrated_at=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        cell=workcell.name,
        mounting=mounting,
        down_base=workcell.gravity_base_m_s2,
        temperature_c=command.temperature_c,
        peg=peg,
    )
    return content, payload


def calibration_message(content: CalibrationFile, payload: Payload, file: str) -> FtCalibration:
    """The calibration for the bus."""
    return FtCalibration(
        calibrated=True,
        date=content.calibrated_at.isoformat(),
        bias=content.bias,
        weight_n=content.weight_n,
        centroid_m=content.centroid_sensor_m,
        gravity_base=floats(payload.weight_base_n / np.linalg.norm(payload.weight_base_n)),
        weight_base_n=floats(payload.weight_base_n),
        residual_force_n=content.force_rms_n,
        residual_moment_nm=content.moment_rms_nm,
        poses=len(content.poses),
        file=file,
    )


def payload_of(told: FtCalibration, workcell: Workcell) -> Payload | None:
    """The calibrated payload, to the last bit; None if nothing was calibrated, or if an older recording lacks it."""
    if not told.calibrated or told.weight_base_n is None:
        return None
    bias, weight, centroid = (np.array(values) for values in (told.bias, told.weight_base_n, told.centroid_m))
    return Payload(bias, weight, centroid, workcell.sensor_mounting())


def _limits(workcell: Workcell, config: ForceTorqueConfig) -> CalibrationLimits:
    sensor = workcell.force_torque
    return CalibrationLimits(
        force_rms_n=config.residual_force_limit_n,
        moment_rms_nm=config.residual_moment_limit_nm,
        down_base=workcell.gravity_base_m_s2,
        tilt_rad=sensor.tilt_limit_rad,
        least_weight_n=config.least_weight_n,
        turn_rad=config.turn_limit_rad,
        range_n=sensor.range_n,
        range_nm=sensor.range_nm,
        weighed_n=sensor.weighed_n,
    )


def _mend(workcell: Workcell, error: MountingTurned) -> str:
    """The setting in the cell's file that corrects the rotation found."""
    pose = workcell.force_torque.turned(workcell.pose_flange_peg(), error.fit.turn_rad)
    turn, position = (", ".join(f"{value:.4f}" for value in part) for part in (pose.rotvec_rad, pose.position_m))
    return f"{{position_m: [{position}], rotvec_rad: [{turn}]}}"
