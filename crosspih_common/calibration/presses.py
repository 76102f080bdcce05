"""Gentle pushes of the peg's tip against something rigid, and dwells in free air: the data and their evaluation.

A push is held at rest at two or more depths. Between two depths the encoders give the travel of the motor side, the
sensor the change of force, and the tip does not move along the plate's normal. The touching corner of the tip follows
from the drawing and the peg's orientation: it is the one farthest along the normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import AwareDatetime, BaseModel, ConfigDict, Field

from crosspih_common.calibration.fitting import CalibrationRefused
from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose, skew
from crosspih_common.geometry.pose import Array
from crosspih_common.messages.base import Joints, Vector3, Vector6
from crosspih_common.shapes import Peg

MIN_PRESSES, MIN_LEVELS = 4, 2
APART_M = 1.5e-4  # the touching corner must be nearer to the plate than the next one by this much


class RestLevel(BaseModel):
    """A dwell at rest: the joint angles, and the sensor's mean with the standard deviation of that mean."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    joints_rad: Joints
    raw: Vector6
    raw_sd: Vector6


class Press(BaseModel):
    """One push: a reading in free air just before it, then levels of increasing depth."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    free: RestLevel
    levels: tuple[RestLevel, ...] = Field(min_length=1)


class Pressed(BaseModel):
    """All measurements. `normal_base` points into the plate; it is from three touches in one orientation."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    taken_at: AwareDatetime
    cell: str = ""
    normal_base: Vector3
    presses: tuple[Press, ...] = ()
    weighings: tuple[RestLevel, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class HeldLevel:
    """A level evaluated: `pose_base_peg` by the encoders, the contact's raw wrench against free air and its sd (6,)."""

    joints_rad: Array
    pose_base_peg: Pose
    raw: Array
    raw_sd: Array


def held(press: Press, workcell: Workcell) -> list[HeldLevel]:
    """The levels of a push; the free reading in the same orientation removes weight and bias."""
    found = []
    for level in press.levels:
        raw = np.asarray(level.raw) - np.asarray(press.free.raw)
        raw_sd = np.hypot(level.raw_sd, press.free.raw_sd)
        joints = np.asarray(level.joints_rad, float)
        found.append(HeldLevel(joints, workcell.pose_base_peg(joints), raw, raw_sd))
    return found


def corners_m(peg: Peg) -> Array:
    """The corners of the peg that can touch a plane first (k, 3), peg frame, m."""
    return np.vstack([peg.outline_m(peg.tip_m), peg.outline_m(peg.taper_start_m)])


def touching_corner(peg: Peg, rotation_base_peg: Array, normal_base: Array) -> tuple[Array, float]:
    """The corner (3,), peg frame, m, that is farthest along the normal, and its distance to the next one, m."""
    corners = corners_m(peg)
    along = corners @ (rotation_base_peg.T @ normal_base)
    order = np.argsort(-along)
    return corners[order[0]], float(along[order[0]] - along[order[1]])


def wrench_base(level: HeldLevel, workcell: Workcell) -> Array:
    """The contact wrench (6,) on the peg about its frame's origin, in the base's axes, N and Nm."""
    on_peg = workcell.sensor_mounting().peg_of_raw @ level.raw
    rotation = level.pose_base_peg.rotation
    return np.concatenate([rotation @ on_peg[:3], rotation @ on_peg[3:]])


def jacobian_at(workcell: Workcell, joints_rad: Array, point_peg_m: Array) -> Array:
    """(3, n): how a point of the peg (3,), peg frame, moves in the base with the joints."""
    whole = workcell.arm().jacobian(joints_rad, workcell.pose_flange_peg())
    lever = workcell.pose_base_peg(joints_rad).rotation @ point_peg_m
    return np.asarray(whole[:3] - skew(lever) @ whole[3:], dtype=float)


def require(pressed: Pressed, least: int = MIN_PRESSES) -> None:
    """Raises CalibrationRefused where there are too few pushes, or one of a single depth."""
    if len(pressed.presses) < least:
        raise CalibrationRefused(f"{len(pressed.presses)} pushes, want {least} or more, in different postures")
    for index, press in enumerate(pressed.presses):
        if len(press.levels) < MIN_LEVELS:
            raise CalibrationRefused(f"push {index + 1} was held at one depth; hold each at two or more")
