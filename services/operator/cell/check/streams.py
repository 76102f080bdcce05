"""The streams of encoders and sensor, checked against their own stamps, against each other and against
outcomes. Pure.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.arm import ArmModel
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import JOINT_STATE
from crosspih_common.messages import JointState, MotionOutcome, RawWrenchBatch
from services.operator.cell.check.presence import UNIX_NS
from services.operator.cli.rows import Row, ok, wrong

DEGREES = 180.0 / np.pi
JOINT_STATE_S = (0.0035, 0.0205)  # 250 times a second, or once a cycle of an arm with a period of up to 20 ms
SAME_RAD, SAME_M, TURNED_RAD = 1e-3, 1e-3, 5e-3
SLOW_RAD_S = 0.01  # a motion below this peak says nothing about speeds
NEAR_S = 0.1


def _like_degrees(ratio: float, tolerance: float = 0.2) -> bool:
    return abs(ratio / DEGREES - 1.0) < tolerance


def check_joint_units(joints_rad: Sequence[float], model: ArmModel) -> Row:
    """Encoders against the arm's limits; degrees taken for radians are far outside of them."""
    name = "joints in rad, inside the limits"
    joints, limits = np.asarray(joints_rad, float), model.limits
    if len(joints) != model.joints:
        return wrong(name, f"{len(joints)} joints, the cell's arm has {model.joints}", "name the arm that is there")
    outside = limits.violations(joints, slack_rad=0.01)
    if not outside:
        return ok(name, ", ".join(f"{value:+.3f}" for value in joints) + " rad")
    if not limits.violations(joints / DEGREES, slack_rad=0.01):
        return wrong(
            name,
            f"{outside[0]}; divided by 57.3 all joints are inside: these are degrees",
            "the driver must give radians, np.deg2rad of what the arm says, and take radians",
        )
    return wrong(name, "; ".join(outside), "name the arm that is there (cell.arm), or drive it back inside")


def check_joint_rate(states: Sequence[JointState]) -> Row:
    """How often joint states come, by their stamps."""
    name = "rate of arm/joint_state"
    stamps = np.array([state.stamp_ns for state in states], dtype=np.int64)
    if len(stamps) < 5:
        return wrong(name, f"{len(stamps)} samples in a dwell", "publish arm/joint_state 250 times a second")
    period_s = float(np.median(np.diff(stamps))) * 1e-9
    if not JOINT_STATE_S[0] <= period_s <= JOINT_STATE_S[1]:
        return wrong(
            name,
            f"one sample every {period_s * 1e3:.3g} ms by its stamps",
            "publish 250 samples a second, or one a cycle where the arm is slower (20 ms at the most)",
        )
    return ok(name, f"{1.0 / period_s:.0f} a second")


def check_wrench_period(batches: Sequence[RawWrenchBatch]) -> Row:
    """The period that each batch declares, against the stamps of the batches."""
    name = "period of ft/raw"
    if len(batches) < 3:
        return wrong(name, f"{len(batches)} batches in a dwell", "publish every sample, in batches of about 10 ms")
    found = [
        (after.stamp_ns - before.stamp_ns) / len(before.samples)
        for before, after in pairwise(batches)
        if after.seq in (before.seq + 1, -1)
    ]
    declared_s = batches[-1].period_ns * 1e-9
    if not found:
        return wrong(name, "batches are lost", "look at the network, or at a machine that is too busy")
    period_s = float(np.median(found)) * 1e-9
    if not 0.9 < period_s / declared_s < 1.1:
        return wrong(
            name,
            f"a sample every {declared_s * 1e3:.3g} ms is declared, the stamps say {period_s * 1e3:.3g} ms",
            "declare the sensor's real period (period_s of the driver, period_ns of the batch), and stamp the first "
            "sample of each batch by its own time",
        )
    return ok(name, f"{1.0 / declared_s:.0f} samples a second, as declared")


def check_stamps(what: str, stamps_ns: Sequence[int], start_ns: int, end_ns: int) -> Row:
    """The stamps of the samples during a dwell that lasted from `start_ns` to `end_ns` of the cell's clock."""
    name = f"stamps of {what}"
    if not len(stamps_ns):
        return wrong(name, "nothing was heard while the arm held still", f"publish {what}; is its device up?")
    stamps = np.asarray(stamps_ns, dtype=np.int64)
    if np.any(np.diff(stamps) < 0):
        return wrong(name, "they go back", "stamp each sample by the time at which it was measured")
    near_ns = round(NEAR_S * 1e9)
    if np.any((stamps >= start_ns - near_ns) & (stamps <= end_ns + near_ns)):
        return ok(name, f"{len(stamps)}, on the cell's clock")
    newest = int(stamps[-1])
    said = "the wall's time (UNIX)" if newest > UNIX_NS else f"{(newest - end_ns) * 1e-9:+.3f} s from the cell's clock"
    return wrong(name, f"on another clock: {said}", "stamp by the clock of the arm's cycle, which `clock` tells")


def check_joint_outcome(states: Sequence[JointState], outcome: MotionOutcome) -> Row:
    """The encoders at the end of a motion: the stream against the outcome."""
    name = "arm/joint_state against outcomes"
    near = [state for state in states if abs(state.stamp_ns - outcome.stamp_ns) <= 2e7]
    if not near:
        return wrong(name, "no sample within 20 ms of an outcome's stamp", "stamp both by the same clock")
    state = min(near, key=lambda one: abs(one.stamp_ns - outcome.stamp_ns))
    streamed, told = np.asarray(state.joints_rad), np.asarray(outcome.joints_rad)
    if len(streamed) != len(told):
        return wrong(name, f"{len(streamed)} joints against {len(told)}", "tell of the same joints in both")
    off = float(np.abs(streamed - told).max())
    if off <= SAME_RAD:
        return ok(name, f"{off:.1e} rad apart at the most")
    ratio = float(np.linalg.norm(streamed) / max(float(np.linalg.norm(told)), 1e-9))
    if _like_degrees(ratio) or _like_degrees(1.0 / max(ratio, 1e-9)):
        which = JOINT_STATE.path if ratio > 1.0 else "the outcome"
        return wrong(name, f"{which} is 57.3 times the other: degrees", "radians everywhere (`joints_rad`)")
    return wrong(name, f"{off:.3g} rad apart", "both are the encoders (the motor side) at the outcome's stamp")


def check_pose_outcome(outcome: MotionOutcome, asked: Pose | None, model: ArmModel, pose_flange_peg: Pose) -> Row:
    """The outcome's pose against its own joints, and against the commanded pose."""
    name = "axes: poses of outcomes"
    told = outcome.pose_base_peg.pose()
    reckoned = model.pose_base_flange(outcome.joints_rad) @ pose_flange_peg
    pairs = [(reckoned, "the joints of the outcome say")] + ([(asked, "was asked")] if asked is not None else [])
    for pose, what in pairs:
        away, turned = told.distance_to_m(pose), told.angle_to_rad(pose)
        if away > SAME_M or turned > TURNED_RAD:
            return wrong(
                name,
                f"the peg is told {away * 1e3:.1f} mm and {np.rad2deg(turned):.2f} degrees from where {what}",
                "the arm's kinematics, the base's axes or cell.flange_to_ft are others than the cell's file says",
            )
    return ok(name, "as the joints say" + ("" if asked is None else " and as asked"))


def check_speeds(states: Sequence[JointState]) -> Row:
    """The reported speeds against the differences of positions, over a motion."""
    name = "joint speeds in rad/s"
    stamps = np.array([state.stamp_ns for state in states], dtype=float) * 1e-9
    positions = np.array([state.joints_rad for state in states])
    told = np.array([state.speeds_rad_s for state in states])
    if len(states) < 10:
        return wrong(name, f"{len(states)} samples in a motion", "publish arm/joint_state 250 times a second")
    inner = slice(1, -1)
    spans = stamps[2:] - stamps[:-2]
    good = (spans > 0.0) & (spans < 0.05)
    reckoned = ((positions[2:] - positions[:-2])[good].T / spans[good]).T
    told = told[inner][good]
    if not reckoned.size or float(np.abs(reckoned).max()) < SLOW_RAD_S:
        return wrong(
            name,
            "the encoders stood still while the arm was told to move",
            "arm/joint_state must follow the arm: read the encoders in each cycle",
        )
    factor = float(np.sum(told * reckoned) / np.sum(reckoned * reckoned))
    if 0.8 <= factor <= 1.25:
        return ok(name, f"{factor:.2f} times the positions differenced")
    if abs(factor) < 0.05 and not _like_degrees(1.0 / max(abs(factor), 1e-9)):
        return wrong(name, "zero while the arm moves", "give the speeds, or the positions differenced")
    if _like_degrees(factor):
        return wrong(name, "57.3 times the positions differenced: degrees a second", "give rad/s (np.deg2rad)")
    return wrong(name, f"{factor:.3g} times the positions differenced", "give rad/s, with the sign of the positions")


def check_wrench_outcome(batches: Sequence[RawWrenchBatch], outcome: MotionOutcome) -> Row:
    """The mean of a dwell's samples against the outcome's. Whatever the units, both are the sensor's own."""
    name = "ft/raw against outcomes"
    samples = samples_within(batches, outcome.start_stamp_ns, outcome.stamp_ns)
    if len(samples) < 5:
        return wrong(name, f"{len(samples)} samples within a dwell", "stamp both by the same clock")
    mean, spread = samples.mean(axis=0), samples.std(axis=0)
    off = np.abs(mean - np.asarray(outcome.wrench_raw))
    if np.all(off <= 4.0 * spread + 1e-3 * np.abs(mean) + 1e-9):
        return ok(name, f"{float(np.max(off)):.2g} apart at the most")
    return wrong(
        name,
        f"the stream's mean is {_shown(mean)}, the outcome says {_shown(outcome.wrench_raw)}",
        "wrench_raw is the mean of the same raw numbers: bias and weight in them, the sensor's units, axes and sign",
    )


def samples_within(batches: Sequence[RawWrenchBatch], start_ns: int, end_ns: int) -> Array:
    """The samples (n, 6) of a span of the cell's time."""
    rows = [
        sample
        for batch in batches
        for index, sample in enumerate(batch.samples)
        if start_ns <= batch.stamp_ns + index * batch.period_ns <= end_ns
    ]
    return np.asarray(rows, float).reshape(-1, 6)


def _shown(values: ArrayLike) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in np.asarray(values, float)) + ")"
