"""The contact force over an assembly, separated from the inertia of the tool. Pure.

Two series show the same force with different bandwidth. *Unfiltered* is every sample of the sensor, with bias and
weight removed by the recorded calibration, computed here. *Filtered* is `force_torque/wrench` as the force_torque
service sent it. Both are the load on the peg, in the peg frame about its origin {K}. Every figure names its series.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import CONTACT_WRENCH, FT_CALIBRATION, WRENCH_RAW
from crosspih_common.messages import FtCalibration
from crosspih_common.recording import Recording
from crosspih_common.wrench import Payload
from services.operator.report.model.motion import AnsweredMotion, JointTrace, in_hole_m
from services.operator.report.model.window import AssemblyWindow

CLEAR_M = 0.003  # with its tip this far before the hole's face the peg can touch nothing of it
STANDARD_GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """Contact wrenches (n, 6), N and Nm, peg frame, at times (n,), s since the command; `free` (n,): where the peg can
    touch nothing.
    """

    time_s: Array
    wrench: Array
    free: NDArray[np.bool_]
    rate_hz: float

    @property
    def force_n(self) -> Array:
        """(n,): |F|."""
        return np.asarray(np.linalg.norm(self.wrench[:, :3], axis=1))

    @property
    def moment_nm(self) -> Array:
        """(n,): |M|."""
        return np.asarray(np.linalg.norm(self.wrench[:, 3:], axis=1))

    def after(self, start_s: float) -> Trace:
        """The part after a time."""
        keep = self.time_s >= start_s
        return Trace(self.time_s[keep], self.wrench[keep], self.free[keep], self.rate_hz)


@dataclass(frozen=True, slots=True)
class Peak:
    """The largest force and the largest moment of some samples, and the time of each, s since the command."""

    force_n: float
    force_at_s: float
    moment_nm: float
    moment_at_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Forces:
    """All forces. In `free_spans` the peg could touch nothing; `inertia` is the peak measured there, and
    `unexplained_n` the largest |F| there after subtracting mass times acceleration of the tool (None: not known).
    """

    unfiltered: Trace | None
    filtered: Trace | None
    free_spans: tuple[tuple[float, float], ...]
    contact_unfiltered: Peak | None
    contact_filtered: Peak | None
    inertia: Peak | None
    unexplained_n: float | None
    calibration: FtCalibration | None

    @property
    def contact(self) -> Peak | None:
        """The contact peak of the headline: of every sample where they are recorded, else of the filtered ones."""
        return self.contact_unfiltered or self.contact_filtered

    @property
    def main(self) -> Trace | None:
        """The series of the headline's peak."""
        return self.unfiltered if self.contact_unfiltered is not None else self.filtered


def forces_of(
    recording: Recording,
    window: AssemblyWindow,
    workcell: Workcell,
    joints: JointTrace | None,
    motions: list[AnsweredMotion],
    pose_base_hole: Pose,
    start_s: float,
) -> Forces:
    """Forces from `start_s` (when the sensor was calibrated) to the assembly's end."""
    calibrations = [each for each in recording.messages(FT_CALIBRATION) if each.stamp_ns <= window.end_ns]
    calibration = calibrations[-1] if calibrations else None
    filtered = _filtered(recording, window)
    unfiltered = None
    if calibration is not None and calibration.calibrated and joints is not None:
        unfiltered = _unfiltered(recording, window, workcell, joints, calibration)
    spans = free_spans(joints, motions, pose_base_hole, window.s(window.end_ns), start_s)
    filtered, unfiltered = (_with_free(trace, spans, start_s) for trace in (filtered, unfiltered))
    free = None if unfiltered is None and filtered is None else peak_of(unfiltered or filtered, free=True)
    unexplained = None
    if unfiltered is not None and joints is not None and calibration is not None and free is not None:
        unexplained = _unexplained_n(unfiltered, joints, calibration, workcell)
    return Forces(
        unfiltered, filtered, spans, peak_of(unfiltered, free=False), peak_of(filtered, free=False), free, unexplained,
        calibration,
    )  # fmt: skip


def free_spans(
    joints: JointTrace | None, motions: list[AnsweredMotion], pose_base_hole: Pose, end_s: float, start_s: float = 0.0
) -> tuple[tuple[float, float], ...]:
    """Times in which the peg could touch nothing: joint trajectories, which planning keeps collision-free, and times at
    which the tip was clear of the hole's face.
    """
    edges = [start_s, end_s]
    if joints is not None:
        edges += joints.time_s.tolist()
    edges += [at for motion in motions if motion.free for at in (motion.start_s, motion.end_s)]
    times = np.unique([at for at in edges if start_s <= at <= end_s])
    if len(times) < 2:
        return ()
    middles = (times[:-1] + times[1:]) / 2.0
    free = np.zeros(len(middles), dtype=bool)
    for motion in motions:
        if motion.free:
            free |= (middles >= motion.start_s) & (middles <= motion.end_s)
    if joints is not None:
        depth_m = np.interp(middles, joints.time_s, in_hole_m(joints, pose_base_hole)[:, 2])
        free |= depth_m < -CLEAR_M
    begins = np.flatnonzero(free & ~np.append(False, free[:-1]))
    ends = np.flatnonzero(free & ~np.append(free[1:], False))
    return tuple((float(times[begin]), float(times[end + 1])) for begin, end in zip(begins, ends, strict=True))


def peak_of(trace: Trace | None, *, free: bool) -> Peak | None:
    """The peak of the samples in free air, or of the others; None where there are none."""
    if trace is None:
        return None
    of = np.flatnonzero(trace.free == free)
    if not len(of):
        return None
    force, moment = trace.force_n[of], trace.moment_nm[of]
    first, second = int(np.argmax(force)), int(np.argmax(moment))
    return Peak(
        float(force[first]), float(trace.time_s[of[first]]), float(moment[second]), float(trace.time_s[of[second]])
    )


def _with_free(trace: Trace | None, spans: tuple[tuple[float, float], ...], start_s: float) -> Trace | None:
    if trace is None:
        return None
    trace = trace.after(start_s)
    if not len(trace.time_s):
        return None
    free = np.zeros(len(trace.time_s), dtype=bool)
    for start, end in spans:
        free |= (trace.time_s >= start) & (trace.time_s <= end)
    return Trace(trace.time_s, trace.wrench, free, trace.rate_hz)


def _filtered(recording: Recording, window: AssemblyWindow) -> Trace | None:
    samples = [sample for sample in recording.messages(CONTACT_WRENCH) if window.holds(sample.stamp_ns)]
    if not samples:
        return None
    samples.sort(key=lambda sample: sample.stamp_ns)
    time_s = np.array([window.s(sample.stamp_ns) for sample in samples])
    return Trace(time_s, np.array([sample.wrench for sample in samples]), np.zeros(len(samples), bool), _rate(time_s))


def _unfiltered(
    recording: Recording, window: AssemblyWindow, workcell: Workcell, joints: JointTrace, calibration: FtCalibration
) -> Trace | None:
    batches = [batch for batch in recording.messages(WRENCH_RAW) if window.holds(batch.stamp_ns)]
    if not batches:
        return None
    batches.sort(key=lambda batch: batch.stamp_ns)
    stamps = np.concatenate([each.stamp_ns + each.period_ns * np.arange(len(each.samples)) for each in batches])
    raw = np.concatenate([np.asarray(each.samples) for each in batches])
    time_s = (stamps - window.start_ns) * 1e-9
    nearest = np.searchsorted(joints.time_s, time_s).clip(0, len(joints.time_s) - 1)
    contact = _payload(calibration, workcell).contact(raw, joints.rotation_base_peg[nearest])
    return Trace(time_s, contact, np.zeros(len(time_s), bool), 1e9 / batches[0].period_ns)


def _payload(calibration: FtCalibration, workcell: Workcell) -> Payload:
    down = np.asarray(calibration.gravity_base)
    weight = calibration.weight_base_n or down / np.linalg.norm(down) * calibration.weight_n
    return Payload(
        np.asarray(calibration.bias), np.asarray(weight), np.asarray(calibration.centroid_m), workcell.sensor_mounting()
    )


def _unexplained_n(trace: Trace, joints: JointTrace, calibration: FtCalibration, workcell: Workcell) -> float:
    """The largest |F| in free air that mass times acceleration of the tool's centroid does not explain."""
    mounting = workcell.sensor_mounting()
    centroid_m = workcell.pose_flange_peg().apply(mounting.pose_peg_sensor.apply(np.asarray(calibration.centroid_m)))
    places = workcell.arm().points_base_m(joints.positions_rad, centroid_m)
    velocity = np.gradient(places, joints.time_s, axis=0)
    acceleration = np.gradient(velocity, joints.time_s, axis=0)
    at = np.stack([np.interp(trace.time_s, joints.time_s, column) for column in acceleration.T], axis=1)
    nearest = np.searchsorted(joints.time_s, trace.time_s).clip(0, len(joints.time_s) - 1)
    in_peg = np.einsum("kji,kj->ki", joints.rotation_base_peg[nearest], at)
    inertia_n = -calibration.weight_n / STANDARD_GRAVITY_M_S2 * in_peg
    return float(np.linalg.norm(trace.wrench[:, :3] - inertia_n, axis=1)[trace.free].max())


def _rate(time_s: Array) -> float:
    return 0.0 if len(time_s) < 2 else float(1.0 / np.median(np.diff(time_s)))
