"""Plausibility checks of a payload: by the sensor's range, by gravity, and by the present reading at rest.

A wrong payload is worse than none: a bias of -55 N makes a push of 107 N look like one of 52 N. At rest and without
contact the reading minus the payload is the payload's error, so it must be small beside the relevant forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array
from crosspih_common.wrench.payload import Payload

IMPLAUSIBLE = "implausible_payload"
"""The code of a refusal with the texts below."""


@dataclass(frozen=True, slots=True)
class PayloadLimits:
    """The limits of a plausible payload. `down_base` (3,), of any length, is the direction of gravity, base frame.

    At rest the residual |F| may be the larger of `residual_n` and `residual_share` of the weight, plus 3 standard
    deviations of the reading; |M| about the sensor the larger of `residual_nm` and that share of weight times centroid.
    """

    range_n: float = 300.0
    range_nm: float = 30.0
    down_base: tuple[float, ...] = (0.0, 0.0, -1.0)
    tilt_rad: float = 0.2
    centroid_m: float = 0.5
    residual_n: float = 2.0
    residual_nm: float = 0.2
    residual_share: float = 0.05


def judge_bounds(payload: Payload, limits: PayloadLimits) -> str | None:
    """Why a payload is implausible for any reading: its field, value and remedy; None if it is plausible."""
    force, moment = (float(np.max(np.abs(part))) for part in (payload.bias[:3], payload.bias[3:]))
    weight, lever = payload.weight_n, float(np.linalg.norm(payload.centroid_sensor_m))
    if force > limits.range_n or moment > limits.range_nm:
        return (
            f"bias: {_shown(payload.bias)} (N, Nm) is beyond the sensor's range of {limits.range_n:g} N and "
            f"{limits.range_nm:g} Nm; calibrate the sensor anew, or mend cell.force_torque.range_n and range_nm"
        )
    if weight > limits.range_n or weight * lever > limits.range_nm:
        return (
            f"weight_n: {weight:.3g} N at {lever:.3g} m is beyond the sensor's range of {limits.range_n:g} N and "
            f"{limits.range_nm:g} Nm; is it in N? (cell.force_torque.force_unit)"
        )
    if lever > limits.centroid_m:
        return f"centroid: {lever:.3g} m from the sensor, more than {limits.centroid_m:g} m; is it in metres?"
    tilt = payload.tilt_rad(limits.down_base)
    if weight > 0.0 and tilt > limits.tilt_rad:
        return (
            f"gravity_base: {degrees(tilt):.1f} degrees from cell.gravity_base_m_s2, more than "
            f"{degrees(limits.tilt_rad):.1f}; set cell.gravity_base_m_s2 to how the base stands, or the sign of the "
            "sensor (cell.force_torque.reports) where it is the other way round"
        )
    return None


def judge_payload(
    payload: Payload, raw_at_rest: ArrayLike, raw_sd: ArrayLike, rotation_base_peg: ArrayLike, limits: PayloadLimits
) -> str | None:
    """Why a payload is implausible given a reading at rest in free air; None if it is plausible.

    raw_at_rest (6,): the mean of raw readings now; raw_sd (6,): its standard deviation; rotation_base_peg (3, 3): now.
    """
    refusal = judge_bounds(payload, limits)
    if refusal is not None:
        return refusal
    read = payload.mounting.sensor(raw_at_rest)
    sd = payload.mounting.sensor_sd(raw_sd)
    if not np.all(np.isfinite(read)) or not np.all(np.isfinite(sd)):
        return "the sensor's reading is not finite; mend its driver"
    force_sd, moment_sd = float(np.linalg.norm(sd[:3])), float(np.linalg.norm(sd[3:]))
    if force_sd > limits.residual_n or moment_sd > limits.residual_nm:
        return (
            f"the sensor does not rest: its mean is known to {force_sd:.2g} N and {moment_sd:.2g} Nm only; "
            "wait until the arm stands still, or look for what shakes it"
        )
    weight, lever = payload.weight_n, float(np.linalg.norm(payload.centroid_sensor_m))
    force_limit = max(limits.residual_n, limits.residual_share * weight) + 3.0 * force_sd
    moment_limit = max(limits.residual_nm, limits.residual_share * weight * lever) + 3.0 * moment_sd
    expected = payload.free_air(payload.mounting.rotation_base_sensor(rotation_base_peg))
    left = read - expected
    force, moment = float(np.linalg.norm(left[:3])), float(np.linalg.norm(left[3:]))
    if force <= force_limit and moment <= moment_limit:
        return None
    return (
        f"at rest it leaves {force:.2f} N and {moment:.3f} Nm as contact, limits {force_limit:.2f} N and "
        f"{moment_limit:.3f} Nm: the sensor reads {_shown(read)} (N, Nm, sensor frame), the payload says "
        f"{_shown(expected)}, of which bias {_shown(payload.bias)}; move the peg clear of everything and try again, "
        "or calibrate the sensor anew (`crosspih calibrate ft`)"
    )


def _shown(values: Array) -> str:
    return "[" + ", ".join(f"{value:.4g}" for value in values) + "]"
