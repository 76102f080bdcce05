"""The stream of contact wrenches: batch after batch, each with the joint states known at its arrival.

Its output depends on the batches, the states and the calibrations alone. Every wrench names the ones it used
(`joint_stamp_ns`, `calibration_seq`) and sometimes carries the state (`memory`), so that a recording can be processed
again from there, to the last bit (again.py).
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import (
    ContactClassifier,
    ContactState,
    ContactWrench,
    JointState,
    RawWrenchBatch,
    WrenchMemory,
    floats,
)
from crosspih_common.wrench import LowPass, Payload
from services.force_torque.at_rest import joint_acceleration_rad_s2
from services.force_torque.compensation import (
    ContactEvent,
    FreeAirSettings,
    FreeAirState,
    OnsetSettings,
    OnsetState,
)
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.judging import Judge
from services.force_torque.online import Pipeline, step

JOINT_STATES = 32  # number of last states for the acceleration
_FIRST_PERIOD_S = 1e-3  # until the first batch states its own
_REMEMBER_NS = 100_000_000
CLEAR_OF_THE_FACE_M = 0.002
DRIFT_OVER = 0.8  # share of its limit; below it a reported drift counts as gone


@dataclass(frozen=True, slots=True)
class BatchResult:
    """The result of one batch. `drift` is the reason to calibrate the sensor again, given once when it first
    applies."""

    wrench: ContactWrench
    state: ContactState | None
    events: list[ContactEvent]
    drift: str


class WrenchStream:
    """Batches in, wrenches out. A calibration may come from another thread."""

    def __init__(self, workcell: Workcell, config: ForceTorqueConfig, judge: Judge) -> None:
        self._arm, self._pose_flange_peg = workcell.arm(), workcell.pose_flange_peg()
        self._config, self._judge = config, judge
        self._stands: tuple[tuple[float, ...], Pose] = (), Pose.identity()
        self._lock = threading.Lock()
        self._pipeline = Pipeline(
            payload=Payload(np.zeros(6), np.zeros(3), np.zeros(3), workcell.sensor_mounting()),
            low_pass=LowPass(config.filter_hz, _FIRST_PERIOD_S),
            onset_settings=OnsetSettings(config.onset_force_n, config.onset_moment_nm, hold_s=config.onset_hold_s),
            free_settings=FreeAirSettings(
                mean_s=config.free_air_mean_s,
                force_limit_n=config.drift_force_n,
                moment_limit_nm=config.drift_moment_nm,
                settle_s=config.free_air_settle_s,
            ),
        )
        peg = workcell.peg.shape()
        self._tip_m = peg.tip_m
        self._pose_hole_base = workcell.hole_prior.pose_base_hole().inverse()
        self._half_ranges = workcell.hole_prior.half_ranges()
        self._widest_m = float(np.linalg.norm(peg.outline_m(peg.tip_m)[:, :2], axis=1).max())
        self.calibration_seq = -1
        self._drifted = False
        self._judged_ns = 0
        self._remembered_ns = 0

    @property
    def calibrated(self) -> bool:
        """Whether any calibration was ever received."""
        return self.calibration_seq >= 0

    @property
    def payload(self) -> Payload:
        """The payload of the present calibration."""
        return self._pipeline.payload

    def use(self, payload: Payload, calibration_seq: int) -> None:
        """Use this calibration from the next batch on; the free-air memory is cleared."""
        with self._lock:
            self._pipeline = self._pipeline.with_payload(payload)
            self.calibration_seq, self._drifted = calibration_seq, False
            self._remembered_ns = 0

    def remember(self, wrench: ContactWrench) -> None:
        """Restore the service's state after that wrench. Raises ValueError if it does not carry its memory."""
        kept = wrench.memory
        if kept is None:
            raise ValueError("the wrench carries no memory; begin at one that does")
        with self._lock:
            self._pipeline = replace(
                self._pipeline,
                low_pass=replace(self._pipeline.low_pass, last=kept.filtered),
                onset=OnsetState(wrench.in_contact, kept.run_samples, kept.run_stamp_ns, kept.run_wrench),
                free=FreeAirState(kept.free_mean, kept.free_samples, kept.settle_left),
            )
            self._drifted, self._judged_ns = wrench.drift_suspected, kept.judged_ns
            self._remembered_ns = wrench.stamp_ns

    def take(self, batch: RawWrenchBatch, states: Sequence[JointState]) -> BatchResult:
        """Process the next batch; states are the last `JOINT_STATES` received, oldest first, at least one."""
        with self._lock:
            return self._take(batch, states)

    def _take(self, batch: RawWrenchBatch, states: Sequence[JointState]) -> BatchResult:
        newest = states[-1]
        pose_base_peg = self._pose_base_peg(newest.joints_rad)
        result = step(
            self._pipeline,
            np.asarray(batch.samples),
            batch.stamp_ns,
            batch.period_ns,
            pose_base_peg.rotation,
            accelerating=joint_acceleration_rad_s2(states) > self._config.still_rad_s2,
            may_touch=self._may_touch(pose_base_peg),
        )
        self._pipeline = result.pipeline
        stamp_ns = batch.stamp_ns + batch.period_ns * (len(batch.samples) - 1)
        free, config = result.free_air, self._config
        drift = free.reason if free.drifted and not self._drifted else ""
        # reported once: a drift at its limit would otherwise be reported at every crossing
        if free.drifted:
            self._drifted = True
        elif max(free.force_n / config.drift_force_n, free.moment_nm / config.drift_moment_nm) < DRIFT_OVER:
            self._drifted = False
        state = None
        due = stamp_ns - self._judged_ns >= self._config.state_every_s * 1e9 or stamp_ns < self._judged_ns
        if result.in_contact and due:
            self._judged_ns = stamp_ns
            judged = self._judge(result.wrench, None, ContactClassifier.RULE)
            state = judged.model_copy(update={"stamp_ns": stamp_ns})
        wrench = ContactWrench(
            stamp_ns=stamp_ns,
            wrench=floats(result.wrench),
            in_contact=result.in_contact,
            free_residual_n=result.free_air.force_n,
            drift_suspected=result.free_air.drifted,
            joint_stamp_ns=newest.stamp_ns,
            calibration_seq=self.calibration_seq,
            memory=self._memory(stamp_ns),
        )
        return BatchResult(wrench, state, result.events, drift)

    def _pose_base_peg(self, joints_rad: tuple[float, ...]) -> Pose:
        """The pose of the peg in the base; computed once while the arm stands still."""
        known, pose = self._stands
        if known != joints_rad:
            pose = self._arm.pose_base_flange(joints_rad) @ self._pose_flange_peg
            self._stands = joints_rad, pose
        return pose

    def _may_touch(self, pose_base_peg: Pose) -> bool:
        """Whether the peg's tip is so deep that it may touch the hole's part, for any place of the part within its
        range."""
        tip = self._pose_hole_base.apply(pose_base_peg.apply([0.0, 0.0, self._tip_m]))
        _, _, depth_m, rx, ry, _ = self._half_ranges
        beside_m = float(np.hypot(tip[0], tip[1])) + self._widest_m
        return bool(tip[2] > -(depth_m + beside_m * float(np.hypot(rx, ry)) + CLEAR_OF_THE_FACE_M))

    def _memory(self, stamp_ns: int) -> WrenchMemory | None:
        if 0 <= stamp_ns - self._remembered_ns < _REMEMBER_NS:
            return None
        self._remembered_ns = stamp_ns
        low_pass, onset, free = self._pipeline.low_pass, self._pipeline.onset, self._pipeline.free
        return WrenchMemory(
            filtered=low_pass.last or (0.0,) * 6,
            run_samples=onset.run_samples,
            run_stamp_ns=onset.run_stamp_ns,
            run_wrench=onset.run_wrench,
            free_mean=free.mean,
            free_samples=free.samples,
            settle_left=free.settle_left,
            judged_ns=self._judged_ns,
        )
