"""Binds calibration, compensation and contact states to their keys."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import numpy as np

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
    JointState,
    PoseData,
    RawWrenchBatch,
    Severity,
    floats,
)
from crosspih_common.service import ServiceContext
from services.force_torque.calibration import CalibrationError, StaticReading, ToolParameters, calibrate
from services.force_torque.calibration_file import CalibrationFile, calibration_file, load_calibration, save_calibration
from services.force_torque.compensation import FreeAirSettings, LowPass, OnsetSettings, compensated
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.judging import Judge
from services.force_torque.online import Pipeline, step

SENSOR_PERIOD_S = 0.001


class ForceTorqueShell:
    """The service on the bus."""

    def __init__(self, context: ServiceContext, config: ForceTorqueConfig) -> None:
        self._context, self._config, self._bus = context, config, context.bus
        self._mounting = config.sensor_correction.pose()
        self._file = Path(config.calibration_file.format(cell=context.cell.workcell.name))
        self._joints = self._bus.latest(JOINT_STATE, depth=8)
        self._wrench = self._bus.publisher(CONTACT_WRENCH)
        self._state = self._bus.publisher(CONTACT_STATE)
        self._calibration = self._bus.publisher(FT_CALIBRATION)
        self._pipeline = Pipeline(
            tool=ToolParameters(np.zeros(6), np.zeros(3), np.zeros(3)),
            low_pass=LowPass(config.filter_hz, SENSOR_PERIOD_S),
            onset_settings=OnsetSettings(config.onset_force_n, config.onset_moment_nm),
            free_settings=FreeAirSettings(force_limit_n=config.drift_force_n, moment_limit_nm=config.drift_moment_nm),
            pose_peg_sensor=self._mounting,
        )
        self._judge = Judge(context.cell.workcell, config.contact_classifier)
        self._calibrated = False
        self._drifted = False
        self._batches = 0
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
                    gravity_base=(0.0, 0.0, -1.0),
                    residual_force_n=0.0,
                    residual_moment_nm=0.0,
                    poses=0,
                )
            )
            return
        try:
            content = load_calibration(self._file)
        except CalibrationError as error:
            self._context.event(Severity.WARNING, "calibration_file", str(error))
            return
        self._use(content)

    def _use(self, content: CalibrationFile) -> FtCalibration:
        tool = ToolParameters(
            np.asarray(content.bias), np.asarray(content.weight_base_n), np.asarray(content.centroid_sensor_m)
        )
        self._pipeline = self._pipeline.with_tool(tool)
        self._calibrated, self._drifted = True, False
        return self._calibration.publish(
            FtCalibration(
                calibrated=True,
                date=content.calibrated_at.isoformat(),
                bias=content.bias,
                weight_n=content.weight_n,
                centroid_m=content.centroid_sensor_m,
                gravity_base=floats(tool.weight_base_n / tool.weight_n),
                residual_force_n=content.force_rms_n,
                residual_moment_nm=content.moment_rms_nm,
                poses=len(content.poses),
                file=str(self._file),
            )
        )

    def _rotation_base_sensor(self, pose_base_peg: PoseData) -> Array:
        return np.asarray(pose_base_peg.pose().rotation @ self._mounting.rotation)

    def _identify(self, command: IdentifyPayload) -> FtCalibration:
        readings = [
            StaticReading(self._rotation_base_sensor(reading.pose_base_peg), np.asarray(reading.wrench_raw))
            for reading in command.readings
        ]
        try:
            found = calibrate(
                readings,
                gravity_free=self._config.gravity_free,
                force_rms_limit_n=self._config.residual_force_limit_n,
                moment_rms_limit_nm=self._config.residual_moment_limit_nm,
            )
        except CalibrationError as error:
            raise CommandRefused("calibration", str(error)) from None
        content = calibration_file(
            found,
            readings,
            calibrated_at=datetime.now(timezone.utc).isoformat(timespec="seconds"),
            cell=self._context.cell.workcell.name,
        )
        if command.save:
            save_calibration(content, self._file)
        return self._use(content)

    def _compensate(self, command: CompensateWrench) -> ContactReading:
        if not self._calibrated:
            raise CommandRefused("not_calibrated", "the sensor was never calibrated; run `crosspih calibrate ft`")
        tool = self._pipeline.tool
        wrench = compensated(
            np.asarray(command.wrench_raw), self._rotation_base_sensor(command.pose_base_peg), tool, self._mounting
        )
        residual = None
        if command.wrench_free_raw is not None:
            free = self._rotation_base_sensor(command.pose_base_peg_free or command.pose_base_peg)
            residual = compensated(np.asarray(command.wrench_free_raw), free, tool, self._mounting)
            wrench = wrench - residual
        return ContactReading(
            wrench=floats(wrench),
            wrench_sd=command.wrench_sd,
            free_residual=None if residual is None else floats(residual),
            state=self._judge(wrench, np.asarray(command.wrench_sd)),
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
        joints = self._joints.value()
        if joints is None or not self._calibrated:
            return
        rotation = self._context.cell.workcell.pose_base_peg(joints.joints_rad).rotation
        result = step(
            self._pipeline,
            np.asarray(batch.samples),
            batch.stamp_ns,
            batch.period_ns,
            rotation,
            accelerating=_acceleration_rad_s2(self._joints.values()) > self._config.still_rad_s2,
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
        self._batches += 1
        if result.in_contact and self._batches % self._config.state_every_batches == 0:
            judged = self._judge(result.wrench, None, ContactClassifier.RULE)
            self._state.publish(judged.model_copy(update={"stamp_ns": stamp_ns}))

    def close(self) -> None:
        """Nothing is held open."""


def _acceleration_rad_s2(states: list[JointState]) -> float:
    """The largest joint acceleration over the last few joint states, by differences of their speeds."""
    if len(states) < 2:
        return 0.0
    speeds = np.array([state.speeds_rad_s for state in states])
    times = np.array([state.stamp_ns for state in states]) * 1e-9
    steps = np.maximum(np.diff(times), 1e-4)
    return float(np.max(np.abs(np.diff(speeds, axis=0)) / steps[:, None]))
