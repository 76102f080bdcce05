"""Binds calibration, compensation and contact states to their keys."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import (
    CLASSIFY,
    COMPENSATE,
    CONTACT_STATE,
    CONTACT_WRENCH,
    FT_CALIBRATION,
    IDENTIFY_PAYLOAD,
    JOINT_STATE,
    WRENCH_RAW,
)
from crosspih_common.messages import (
    ClassifyContacts,
    CompensateWrench,
    ContactClassifier,
    ContactReading,
    ContactStates,
    ContactWrench,
    FtCalibration,
    IdentifyPayload,
    RawWrenchBatch,
    Severity,
    floats,
)
from crosspih_common.service import ServiceContext
from crosspih_common.wrench import IMPLAUSIBLE, LowPass, Payload, judge_bounds, judge_payload
from services.force_torque.at_rest import RestingWindow, joint_acceleration_rad_s2
from services.force_torque.calibration import (
    CalibrationError,
    CalibrationLimits,
    MountingTurned,
    StaticReading,
    calibrate,
)
from services.force_torque.calibration_file import CalibrationFile, calibration_file, load_calibration, save_calibration
from services.force_torque.compensation import FreeAirSettings, OnsetSettings
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.judging import Judge
from services.force_torque.online import Pipeline, step

_FIRST_PERIOD_S = 1e-3  # until the first batch says its own
_JOINT_STATES = 32


class ForceTorqueShell:
    """The service on the bus."""

    def __init__(self, context: ServiceContext, config: ForceTorqueConfig) -> None:
        self._context, self._config, self._bus = context, config, context.bus
        self._workcell = context.cell.workcell
        self._mounting, self._limits = self._workcell.sensor_mounting(), self._workcell.payload_limits()
        self._file = Path(config.calibration_file.format(cell=self._workcell.name))
        self._joints = self._bus.latest(JOINT_STATE, depth=_JOINT_STATES)
        self._resting = RestingWindow()
        self._wrench = self._bus.publisher(CONTACT_WRENCH)
        self._state = self._bus.publisher(CONTACT_STATE)
        self._calibration = self._bus.publisher(FT_CALIBRATION)
        self._pipeline = Pipeline(
            payload=Payload(np.zeros(6), np.zeros(3), np.zeros(3), self._mounting),
            low_pass=LowPass(config.filter_hz, _FIRST_PERIOD_S),
            onset_settings=OnsetSettings(config.onset_force_n, config.onset_moment_nm, hold_s=config.onset_hold_s),
            free_settings=FreeAirSettings(
                mean_s=config.free_air_mean_s,
                force_limit_n=config.drift_force_n,
                moment_limit_nm=config.drift_moment_nm,
                settle_s=config.free_air_settle_s,
            ),
        )
        self._judge = Judge(context.cell.workcell, config.contact_classifier)
        self._calibrated = False
        self._drifted = False
        self._judged_ns = 0
        self._load()
        self._bus.subscribe(WRENCH_RAW, self._on_batch)
        self._bus.serve(IDENTIFY_PAYLOAD, self._identify)
        self._bus.serve(COMPENSATE, self._compensate)
        self._bus.serve(CLASSIFY, self._classify)

    def _load(self) -> None:
        if not self._file.exists():
            self._calibration.publish(
                FtCalibration(
                    calibrated=False,
                    bias=(0.0,) * 6,
                    weight_n=0.0,
                    centroid_m=(0.0,) * 3,
                    gravity_base=floats(_unit(self._workcell.gravity_base_m_s2)),
                    residual_force_n=0.0,
                    residual_moment_nm=0.0,
                    poses=0,
                )
            )
            return
        try:
            content = load_calibration(self._file)
            payload = content.payload(self._mounting)
            refusal = judge_bounds(payload, self._limits)
            if refusal is not None:
                raise CalibrationError(refusal)
        except CalibrationError as error:
            self._context.event(Severity.WARNING, "calibration_file", f"{self._file}: not used: {error}")
            return
        self._use(content, payload)

    def _use(self, content: CalibrationFile, payload: Payload) -> FtCalibration:
        self._pipeline = self._pipeline.with_payload(payload)
        self._calibrated, self._drifted = True, False
        return self._calibration.publish(
            FtCalibration(
                calibrated=True,
                date=content.calibrated_at.isoformat(),
                bias=content.bias,
                weight_n=content.weight_n,
                centroid_m=content.centroid_sensor_m,
                gravity_base=floats(_unit(payload.weight_base_n)),
                residual_force_n=content.force_rms_n,
                residual_moment_nm=content.moment_rms_nm,
                poses=len(content.poses),
                file=str(self._file),
            )
        )

    def _identify(self, command: IdentifyPayload) -> FtCalibration:
        readings = [
            StaticReading(
                self._mounting.rotation_base_sensor(reading.pose_base_peg.pose().rotation),
                self._mounting.sensor(reading.wrench_raw),
            )
            for reading in command.readings
        ]
        try:
            found = calibrate(readings, gravity_free=self._config.gravity_free, limits=self._calibration_limits())
        except MountingTurned as error:
            raise CommandRefused("calibration", f"{error}: {self._mend(error)}") from None
        except CalibrationError as error:
            raise CommandRefused("calibration", str(error)) from None
        payload = replace(found.payload, mounting=self._mounting)
        self._check_plausible(payload)
        content = calibration_file(
            found,
            readings,
            calibrated_at=datetime.now(timezone.utc).isoformat(timespec="seconds"),
            cell=self._workcell.name,
            mounting=self._mounting,
            down_base=self._workcell.gravity_base_m_s2,
        )
        if command.save:
            save_calibration(content, self._file)
        return self._use(content, payload)

    def _calibration_limits(self) -> CalibrationLimits:
        config, sensor = self._config, self._workcell.force_torque
        return CalibrationLimits(
            force_rms_n=config.residual_force_limit_n,
            moment_rms_nm=config.residual_moment_limit_nm,
            down_base=self._workcell.gravity_base_m_s2,
            tilt_rad=sensor.tilt_limit_rad,
            least_weight_n=config.least_weight_n,
            turn_rad=config.turn_limit_rad,
            weighed_n=sensor.weighed_n,
        )

    def _mend(self, error: MountingTurned) -> str:
        """What the cell's file has to say for the turn that was found."""
        pose = self._workcell.force_torque.turned(self._workcell.pose_flange_peg(), error.fit.turn_rad)
        turn, position = (", ".join(f"{value:.4f}" for value in part) for part in (pose.rotvec_rad, pose.position_m))
        return f"{{position_m: [{position}], rotvec_rad: [{turn}]}}"

    def _check_plausible(self, payload: Payload) -> None:
        """Beside what the sensor reads now, where the arm is known to be at rest."""
        refusal = judge_bounds(payload, self._limits)
        resting = self._resting.reading(self._joints.values(), self._bus.clock.now_ns())
        joints = self._joints.value()
        if refusal is None and resting is not None and joints is not None:
            rotation = self._workcell.pose_base_peg(joints.joints_rad).rotation
            refusal = judge_payload(payload, resting.mean, resting.sd, rotation, self._limits)
        if refusal is not None:
            raise CommandRefused(IMPLAUSIBLE, refusal)

    def _compensate(self, command: CompensateWrench) -> ContactReading:
        if not self._calibrated:
            raise CommandRefused("not_calibrated", "the sensor was never calibrated; run `crosspih calibrate ft`")
        payload = self._pipeline.payload
        sd = self._mounting.peg_sd(command.wrench_sd)
        wrench = payload.contact(command.wrench_raw, command.pose_base_peg.pose().rotation)
        residual = None
        if command.wrench_free_raw is not None:
            free = (command.pose_base_peg_free or command.pose_base_peg).pose().rotation
            residual = payload.contact(command.wrench_free_raw, free)
            wrench = wrench - residual
        return ContactReading(
            wrench=floats(wrench),
            wrench_sd=floats(sd),
            free_residual=None if residual is None else floats(residual),
            state=self._judge(wrench, sd),
        )

    def _classify(self, command: ClassifyContacts) -> ContactStates:
        if len(command.wrench_sds) != len(command.wrenches):
            raise CommandRefused(
                "lengths",
                f"{len(command.wrenches)} wrenches with {len(command.wrench_sds)} wrench_sds; want one for each",
            )
        pairs = zip(command.wrenches, command.wrench_sds, strict=True)
        return ContactStates(
            states=tuple(self._judge(np.asarray(wrench), np.asarray(sd), command.classifier) for wrench, sd in pairs)
        )

    def _on_batch(self, batch: RawWrenchBatch) -> None:
        self._resting.add(batch)
        joints = self._joints.value()
        if joints is None or not self._calibrated:
            return
        rotation = self._workcell.pose_base_peg(joints.joints_rad).rotation
        result = step(
            self._pipeline,
            np.asarray(batch.samples),
            batch.stamp_ns,
            batch.period_ns,
            rotation,
            accelerating=joint_acceleration_rad_s2(self._joints.values()) > self._config.still_rad_s2,
        )
        self._pipeline = result.pipeline
        stamp_ns = batch.stamp_ns + batch.period_ns * (len(batch.samples) - 1)
        self._wrench.publish(
            ContactWrench(
                stamp_ns=stamp_ns,
                wrench=floats(result.wrench),
                in_contact=result.in_contact,
                free_residual_n=result.free_air.force_n,
                drift_suspected=result.free_air.drifted,
            )
        )
        for event in result.events:
            self._context.event(Severity.INFO, f"contact_{event.change.value}", f"at {event.stamp_ns * 1e-9:.3f} s")
        if result.free_air.drifted and not self._drifted:
            self._context.event(Severity.WARNING, "drift", result.free_air.reason)
        self._drifted = result.free_air.drifted
        due = stamp_ns - self._judged_ns >= self._config.state_every_s * 1e9 or stamp_ns < self._judged_ns
        if result.in_contact and due:
            self._judged_ns = stamp_ns
            judged = self._judge(result.wrench, None, ContactClassifier.RULE)
            self._state.publish(judged.model_copy(update={"stamp_ns": stamp_ns}))

    def close(self) -> None:
        """Nothing is held open."""


def _unit(vector: ArrayLike) -> Array:
    values = np.asarray(vector, dtype=float)
    return np.asarray(values / np.linalg.norm(values), dtype=float)
