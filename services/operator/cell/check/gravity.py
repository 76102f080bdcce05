"""Checks the sensor's sign, axes and units by the weight of the tool. Pure.

When the tool is turned by known angles, its weight changes by known amounts in the sensor's frame, whatever the bias
is. The rotation and the sign that map the expected changes to the measured ones (Kabsch 1976, Acta Cryst. A32, 922) are
those by which the sensor differs from the cell's file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from crosspih_common.config import Workcell
from crosspih_common.config.force_torque import FORCE_UNITS, Reports, SensorSection
from crosspih_common.geometry.pose import Array
from services.operator.cli.rows import Row, ok, skipped, wrong

SIGN, RANGE, UNIT, MOMENT = "sensor's sign and axes", "sensor within its range", "unit of force", "unit of moment"
TURN_LIMIT_RAD = 0.1
MIN_WEIGHT_N = 0.2
LEVER_M = 0.5
UNIT_TOLERANCE = 0.12
RESIDUAL_SHARE = 0.15  # share of the measured changes
MIN_SPREAD = 0.05  # share of the unit weight's direction, in its second direction


@dataclass(frozen=True, slots=True, eq=False)
class DwellReading:
    """A dwell: the peg's orientation (3, 3), the raw mean (6,), and the standard deviation of that mean (6,)."""

    rotation_base_peg: Array
    raw: Array
    raw_sd: Array


@dataclass(frozen=True, slots=True, eq=False)
class FeltWeight:
    """How the measured weight differs from the one that the cell's file predicts.

    sign: -1 where reversed. turn_rad (3,): rotation vector of the real sensor's frame in the frame of the file.
    weight_n: as read. residual: the unexplained part as a share of the changes. lever_m: changed moment over force.
    """

    sign: int
    turn_rad: Array
    weight_n: float
    residual: float
    lever_m: float


def felt_weight(readings: Sequence[DwellReading], workcell: Workcell) -> FeltWeight | None:
    """The weight from at least three orientations; None where they do not differ enough in two directions."""
    mounting, gravity = workcell.sensor_mounting(), np.asarray(workcell.gravity_base_m_s2, float)
    down = gravity / np.linalg.norm(gravity)
    expected = np.array([mounting.rotation_base_sensor(one.rotation_base_peg).T @ down for one in readings])
    wrenches = np.array([mounting.sensor(one.raw) for one in readings])
    expected -= expected.mean(axis=0)
    wrenches -= wrenches.mean(axis=0)
    forces, moments = wrenches[:, :3], wrenches[:, 3:]
    if len(readings) < 3 or np.linalg.svd(expected, compute_uv=False)[1] < MIN_SPREAD:
        return None
    size = float(np.sum(forces * forces))
    found = []
    for sign in (1, -1):
        left, _, right = np.linalg.svd(sign * forces.T @ expected)
        turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        model = sign * expected @ turn.T
        weight = max(float(np.sum(forces * model) / np.sum(model * model)), 0.0)
        rest = float(np.sum((forces - weight * model) ** 2))
        found.append((sign, turn, weight, rest))
    sign, turn, weight, rest = min(found, key=lambda one: one[3])
    upright = found[0]
    noise = sum(float(np.sum(mounting.sensor_sd(one.raw_sd)[:3] ** 2)) for one in readings)
    if sign < 0 and _angle(upright[1]) < TURN_LIMIT_RAD and upright[3] < rest + 9.0 * noise:
        sign, turn, weight, rest = upright  # a sensor without an error explains it as well
    lever = float(np.sqrt(np.sum(moments * moments) / size)) if size > 0.0 else 0.0
    share = float(np.sqrt(rest / size)) if size > 0.0 else 0.0
    return FeltWeight(sign, Rotation.from_matrix(turn.T).as_rotvec(), weight, share, lever)


def _angle(rotation: Array) -> float:
    return float(Rotation.from_matrix(rotation).magnitude())


def check_range(raw: ArrayLike, workcell: Workcell) -> Row:
    """At rest no sensor reads beyond its range; checked before its readings are used to move anything."""
    section = workcell.force_torque
    wrench = workcell.sensor_mounting().sensor(raw)
    force, moment = float(np.abs(wrench[:3]).max()), float(np.abs(wrench[3:]).max())
    if not np.all(np.isfinite(wrench)):
        return wrong(RANGE, "it reads what is no number", "mend the sensor's driver")
    if force <= section.range_n and moment <= section.range_nm:
        return ok(RANGE, f"{force:.3g} N and {moment:.3g} Nm at rest")
    return wrong(
        RANGE,
        f"at rest it reads {force:.4g} N and {moment:.4g} Nm, its range is {section.range_n:g} N and "
        f"{section.range_nm:g} Nm",
        "if the driver tells mN and mNm say so: cell.force_torque.force_unit: mN, moment_unit: mNm; else something "
        "presses on it, or range_n and range_nm are not those of its data sheet",
    )


def check_sign(felt: FeltWeight | None, workcell: Workcell) -> Row:
    """Whether the measured weight points down, along the axes of the cell's file."""
    if felt is None:
        return skipped(SIGN, "the wrist could not be tilted in two directions")
    if felt.weight_n < 1e-6:
        return wrong(SIGN, "no force changes with the tilt", "is the sensor connected, and does its driver read it?")
    if felt.residual > RESIDUAL_SHARE:
        return wrong(
            SIGN,
            f"{felt.residual:.0%} of the change of force is no turned weight",
            "something pulls or presses (a cable, a contact), an axis has a gain of its own, or the sensor drifts: "
            "free the tool and let the sensor warm up",
        )
    angle = float(np.linalg.norm(felt.turn_rad))
    if felt.sign > 0 and angle <= TURN_LIMIT_RAD:
        return ok(SIGN, f"the weight hangs down, {np.rad2deg(angle):.1f} degrees from the file's axes")
    reversed_sign = "its sign is reversed: the weight points up" if felt.sign < 0 else ""
    turned = ""
    if angle > TURN_LIMIT_RAD:
        axis = ", ".join(f"{value / angle:+.2f}" for value in felt.turn_rad)
        turned = f"it is turned by {np.rad2deg(angle):.0f} degrees about ({axis}) of its own frame"
    return wrong(SIGN, "; ".join(text for text in (reversed_sign, turned) if text), _mend_mounting(felt, workcell))


def _mend_mounting(felt: FeltWeight, workcell: Workcell) -> str:
    section, said = workcell.force_torque, []
    if felt.sign < 0:
        other = Reports.REACTION if section.reports is Reports.LOAD else Reports.LOAD
        said.append(f"cell.force_torque.reports: {other.value}")
    if np.linalg.norm(felt.turn_rad) > TURN_LIMIT_RAD:
        axes = _axes(felt, section, workcell)
        if axes is not None:
            said.append(f"cell.force_torque.axes: [{', '.join(axes)}]")
        else:
            mounted = section.turned(workcell.pose_flange_peg(), felt.turn_rad)
            turn = ", ".join(f"{value:.3f}" for value in mounted.rotvec_rad or ())
            place = ", ".join(f"{value:.4f}" for value in mounted.position_m)
            said.append(f"cell.force_torque.pose_flange_sensor: {{position_m: [{place}], rotvec_rad: [{turn}]}}")
    return "; ".join(said) + "; then calibrate again (`crosspih calibrate ft`)"


def _axes(felt: FeltWeight, section: SensorSection, workcell: Workcell) -> tuple[str, ...] | None:
    """The `axes` that undo the rotation, where it is one by right angles."""
    wanted = Rotation.from_rotvec(felt.turn_rad).as_matrix() @ workcell.sensor_mounting().axes
    rounded = np.round(wanted)
    if abs(np.linalg.det(rounded)) < 0.5 or np.abs(wanted - rounded).max() > TURN_LIMIT_RAD:
        return None
    columns = [int(np.argmax(np.abs(row))) for row in rounded]
    return tuple(("-" if row[column] < 0 else "") + "xyz"[column] for row, column in zip(rounded, columns, strict=True))


def check_unit(felt: FeltWeight | None, workcell: Workcell, known_n: float | None, known_from: str) -> Row:
    """The weight as read against a known one; without one only impossible values are found."""
    if felt is None:
        return skipped(UNIT, "the wrist could not be tilted in two directions")
    section, read = workcell.force_torque, felt.weight_n
    if known_n is None:
        if read > section.range_n or read < MIN_WEIGHT_N:
            return wrong(
                UNIT,
                f"a weight of {read:.3g} N hangs on a sensor of {section.range_n:g} N",
                f"cell.force_torque.force_unit is {section.force_unit}: want {_unit_for(read, section)}; or nothing "
                "hangs on the sensor",
            )
        return ok(
            UNIT, f"weight {read:.2f} N; hold it against scales (cell.force_torque.weighed_n): lbf looks no different"
        )
    if abs(read / known_n - 1.0) <= UNIT_TOLERANCE:
        return ok(UNIT, f"weight {read:.2f} N, {known_n:.2f} N by {known_from}")
    now = FORCE_UNITS[section.force_unit]
    for unit, n_per_unit in FORCE_UNITS.items():
        if abs(read * n_per_unit / now / known_n - 1.0) <= UNIT_TOLERANCE and unit != section.force_unit:
            return wrong(
                UNIT,
                f"weight {read:.4g} N as read, {known_n:.4g} N by {known_from}: the driver tells {unit}",
                f"cell.force_torque.force_unit: {unit}, and moment_unit to match",
            )
    return wrong(
        UNIT,
        f"weight {read:.4g} N as read, {known_n:.4g} N by {known_from}",
        "weigh the tool again (cell.force_torque.weighed_n), or calibrate the sensor anew (`crosspih calibrate ft`)",
    )


def _unit_for(read_n: float, section: SensorSection) -> str:
    order = sorted(FORCE_UNITS, key=lambda unit: FORCE_UNITS[unit])
    index = order.index(section.force_unit) + (-1 if read_n > section.range_n else 1)
    return order[min(max(index, 0), len(order) - 1)] if section.force_unit != "N" else ("mN" if read_n > 1 else "kN")


def check_moment(felt: FeltWeight | None) -> Row:
    """The distance from the sensor at which the weight would have to hang to explain the changes of the moment."""
    if felt is None:
        return skipped(MOMENT, "the wrist could not be tilted in two directions")
    if felt.lever_m > LEVER_M:
        return wrong(
            MOMENT,
            f"the weight would hang {felt.lever_m:.3g} m from the sensor",
            "if the driver tells mNm or Nmm say so: cell.force_torque.moment_unit",
        )
    return ok(MOMENT, f"the weight hangs at least {felt.lever_m * 1e3:.0f} mm from the sensor")
