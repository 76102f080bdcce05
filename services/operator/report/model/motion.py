"""The motion of the arm: joints with their limits, the path of the tip, and each commanded motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import ADMITTANCE_MOVE, DWELL, FOLLOW, GUARDED_MOVE, JOINT_STATE, MOVE_LINEAR, Command
from crosspih_common.messages import MotionOutcome
from crosspih_common.recording import Recording
from services.operator.report.model.window import AssemblyWindow

# an acceleration is the slope of a parabola fitted over this many encoder samples (Savitzky and Golay 1964)
FITTED_SAMPLES = 9
KINDS = {
    FOLLOW: "joint trajectory",
    MOVE_LINEAR: "straight move",
    GUARDED_MOVE: "guarded move",
    ADMITTANCE_MOVE: "compliant push",
    DWELL: "dwell",
}


@dataclass(frozen=True, slots=True)
class AnsweredMotion:
    """One motion as the arm answered it, s of cell time since the command; `free` where the peg could touch nothing."""

    command: str
    kind: str
    start_s: float
    end_s: float
    outcome: MotionOutcome
    free: bool


@dataclass(frozen=True, slots=True)
class JointUse:
    """One joint over the assembly, degrees and seconds; the limits are the arm's."""

    name: str
    lowest_deg: float
    highest_deg: float
    lower_deg: float
    upper_deg: float
    to_stop_deg: float
    speed_deg_s: float
    speed_limit_deg_s: float
    acceleration_deg_s2: float
    acceleration_limit_deg_s2: float


@dataclass(frozen=True, slots=True, eq=False)
class JointTrace:
    """From the encoders: `time_s` (k,), positions, speeds and accelerations (k, n), rad; the tip (k, 3), m, base frame,
    and the peg's orientation (k, 3, 3) there. Without the deflection of arm and wrist.
    """

    time_s: Array
    positions_rad: Array
    speeds_rad_s: Array
    accelerations_rad_s2: Array
    tip_m: Array
    rotation_base_peg: Array

    def at(self, time_s: float) -> Array:
        """The joints (n,) at a time."""
        return np.array([np.interp(time_s, self.time_s, column) for column in self.positions_rad.T])

    def tip_path_m(self) -> float:
        """The length of the tip's path."""
        return float(np.linalg.norm(np.diff(self.tip_m, axis=0), axis=1).sum())


def motions_of(recording: Recording, window: AssemblyWindow) -> list[AnsweredMotion]:
    """All motions that were answered within the assembly, in order."""
    found: list[AnsweredMotion] = []
    command: Command[object, MotionOutcome]  # type: ignore[type-var]
    for command, kind in KINDS.items():  # type: ignore[assignment]
        for reply in recording.messages(command.reply_echo):
            if window.holds(reply.stamp_ns):
                start, end = window.s(reply.start_stamp_ns), window.s(reply.stamp_ns)
                found.append(AnsweredMotion(command.path, kind, start, end, reply, command.path == FOLLOW.path))
    return sorted(found, key=lambda motion: motion.start_s)


def joints_of(
    recording: Recording, window: AssemblyWindow, workcell: Workcell, start_s: float = 0.0
) -> JointTrace | None:
    """The encoders from `start_s` to the assembly's end; None where too few samples are recorded."""
    states = [state for state in recording.messages(JOINT_STATE) if window.holds(state.stamp_ns)]
    states = [
        state
        for state in states
        if len(state.joints_rad) == workcell.arm().joints and window.s(state.stamp_ns) >= start_s
    ]
    stamps, keep = np.unique([state.stamp_ns for state in states], return_index=True)
    if len(stamps) <= FITTED_SAMPLES:
        return None
    positions = np.array([states[index].joints_rad for index in keep])
    speeds = np.array([states[index].speeds_rad_s for index in keep])
    time_s = (stamps - window.start_ns) * 1e-9
    arm, peg = workcell.arm(), workcell.pose_flange_peg()

    def points(of_peg_m: tuple[float, float, float]) -> Array:
        return arm.points_base_m(positions, peg.apply(np.array(of_peg_m)))

    origin = points((0.0, 0.0, 0.0))
    axes = [points((1.0, 0.0, 0.0)) - origin, points((0.0, 1.0, 0.0)) - origin, points((0.0, 0.0, 1.0)) - origin]
    return JointTrace(
        time_s, positions, speeds, _accelerations(time_s, speeds),
        points((0.0, 0.0, workcell.peg.shape().tip_m)), np.stack(axes, axis=2),
    )  # fmt: skip


def _accelerations(time_s: Array, speeds: Array) -> Array:
    """(k, n), from speeds at times that may have gaps: nothing is fitted across a gap."""
    accelerations = np.zeros_like(speeds)
    period_s = float(np.median(np.diff(time_s)))
    breaks = np.flatnonzero(np.diff(time_s) > 3.0 * period_s) + 1
    for piece in np.split(np.arange(len(time_s)), breaks):
        if len(piece) >= FITTED_SAMPLES:
            accelerations[piece] = savgol_filter(
                speeds[piece], FITTED_SAMPLES, 2, deriv=1, delta=period_s, axis=0, mode="interp"
            )
    return accelerations


def joint_uses(trace: JointTrace, workcell: Workcell) -> list[JointUse]:
    """Each joint with its limits."""
    limits = workcell.arm().limits
    low, high = np.degrees(trace.positions_rad.min(axis=0)), np.degrees(trace.positions_rad.max(axis=0))
    lower, upper = np.degrees(limits.lower_rad), np.degrees(limits.upper_rad)
    speeds = np.degrees(np.abs(trace.speeds_rad_s).max(axis=0))
    accelerations = np.degrees(np.abs(trace.accelerations_rad_s2).max(axis=0))
    return [
        JointUse(
            f"J{index + 1}", float(low[index]), float(high[index]), float(lower[index]), float(upper[index]),
            float(min(low[index] - lower[index], upper[index] - high[index])), float(speeds[index]),
            float(np.degrees(limits.speed_rad_s[index])), float(accelerations[index]),
            float(np.degrees(limits.acceleration_rad_s2[index])),
        )
        for index in range(len(low))
    ]  # fmt: skip


def in_hole_m(trace: JointTrace, pose_base_hole: Pose) -> Array:
    """The tip (k, 3), m, in a hole's frame: x and y across its axis, z into it from its face."""
    return pose_base_hole.inverse().apply(trace.tip_m)
