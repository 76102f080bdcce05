"""Binds calibration, compensation and contact states to their keys."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from crosspih_common.errors import CommandRefused
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
    ContactReading,
    ContactStates,
    FtCalibration,
    IdentifyPayload,
    RawWrenchBatch,
    Severity,
    floats,
)
from crosspih_common.service import ServiceContext
from crosspih_common.wrench import IMPLAUSIBLE, Payload, judge_bounds, judge_payload
from services.force_torque.answering import calibration_message, classified, compensated, identified
from services.force_torque.at_rest import RestingWindow
from services.force_torque.calibration import CalibrationError
from services.force_torque.calibration_file import CalibrationFile, load_calibration, save_calibration
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.judging import Judge
from services.force_torque.stream import JOINT_STATES, WrenchStream


class ForceTorqueShell:
    """The service on the bus."""

    def __init__(self, context: ServiceContext, config: ForceTorqueConfig) -> None:
        self._context, self._config, self._bus = context, config, context.bus
        self._workcell = context.cell.workcell
        self._mounting, self._limits = self._workcell.sensor_mounting(), self._workcell.payload_limits()
        self._file = Path(config.calibration_file.format(cell=self._workcell.name))
        self._joints = self._bus.latest(JOINT_STATE, depth=JOINT_STATES)
        self._resting = RestingWindow()
        self._wrench = self._bus.publisher(CONTACT_WRENCH)
        self._state = self._bus.publisher(CONTACT_STATE)
        self._calibration = self._bus.publisher(FT_CALIBRATION)
        self._judge = Judge(context.cell.workcell, config.contact_classifier)
        self._stream = WrenchStream(self._workcell, config, self._judge)
        self._load()
        self._bus.subscribe(WRENCH_RAW, self._on_batch)
        self._bus.serve(IDENTIFY_PAYLOAD, self._identify)
        self._bus.serve(COMPENSATE, self._compensate)
        self._bus.serve(CLASSIFY, self._classify)

    def _load(self) -> None:
        if not self._file.exists():
            gravity = np.asarray(self._workcell.gravity_base_m_s2, dtype=float)
            self._calibration.publish(
                FtCalibration(
                    calibrated=False,
                    bias=(0.0,) * 6,
                    weight_n=0.0,
                    centroid_m=(0.0,) * 3,
                    gravity_base=floats(gravity / np.linalg.norm(gravity)),
                    residual_force_n=0.0,
                    residual_moment_nm=0.0,
                    poses=0,
                )
            )
            return
        try:
            content = load_calibration(self._file)
            payload = content.payload(self._mounting, self._workcell.peg.shape())
            refusal = judge_bounds(payload, self._limits)
            if refusal is not None:
                raise CalibrationError(refusal)
        except CalibrationError as error:
            self._context.event(Severity.WARNING, "calibration_file", f"{self._file}: not used: {error}")
            return
        self._use(content, payload)

    def _use(self, content: CalibrationFile, payload: Payload) -> FtCalibration:
        told = calibration_message(content, payload, str(self._file))
        seq, _ = self._calibration.publish(told)
        self._stream.use(payload, seq)
        return told

    def _identify(self, command: IdentifyPayload) -> FtCalibration:
        content, payload = identified(self._workcell, self._config, command)
        self._check_plausible(payload)
        for warning in content.warnings:
            self._context.event(Severity.WARNING, "calibration", warning)
        if command.save:
            save_calibration(content, self._file)
        return self._use(content, payload)

    def _check_plausible(self, payload: Payload) -> None:
        """Compare with the sensor's present reading, if the arm is known to be at rest."""
        refusal = None
        resting = self._resting.reading(self._joints.values(), self._bus.clock.now_ns())
        joints = self._joints.value()
        if resting is not None and joints is not None:
            rotation = self._workcell.pose_base_peg(joints.joints_rad).rotation
            refusal = judge_payload(payload, resting.mean, resting.sd, rotation, self._limits)
        if refusal is not None:
            raise CommandRefused(IMPLAUSIBLE, refusal)

    def _compensate(self, command: CompensateWrench) -> ContactReading:
        if not self._stream.calibrated:
            raise CommandRefused("not_calibrated", "the sensor was never calibrated; run `crosspih calibrate ft`")
        return compensated(self._stream.payload, self._judge, command)

    def _classify(self, command: ClassifyContacts) -> ContactStates:
        return classified(self._judge, command)

    def _on_batch(self, batch: RawWrenchBatch) -> None:
        self._resting.add(batch)
        states = self._joints.values()
        if not states or not self._stream.calibrated:
            return
        told = self._stream.take(batch, states)
        self._wrench.publish(told.wrench)
        for event in told.events:
            self._context.event(Severity.INFO, f"contact_{event.change.value}", f"at {event.stamp_ns * 1e-9:.3f} s")
        if told.drift:
            self._context.event(Severity.WARNING, "drift", told.drift)
        if told.state is not None:
            self._state.publish(told.state)

    def close(self) -> None:
        """Nothing to release."""
