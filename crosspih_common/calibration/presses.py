"""Gentle pushes of the peg's tip against something rigid, and dwells in free air: what was taken, and what it means.

A push is held at two or more depths, at rest: the encoders say how far the motor side went on, the sensor how much
harder it pressed, and the tip has gone nowhere along the plate's normal. The corner of the tip that touches follows
from the drawing and from how the peg stands: the one farthest along the normal.
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
APART_M = 1.5e-4  # by which the corner that touches is nearer to the plate than the next one


class RestLevel(BaseModel):
    """At rest: the encoders, and the sensor's own mean over a dwell with the sd of that mean."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    joints_rad: Joints
    raw: Vector6
    raw_sd: Vector6


class Press(BaseModel):
    """One push: free air just before it, then deeper and deeper."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    free: RestLevel
    levels: tuple[RestLevel, ...] = Field(min_length=1)


class Pressed(BaseModel):
    """All that was taken. `normal_base` points into the plate, as three touches in one orientation found it."""

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
    """The levels of a push, weight and bias taken off by the free reading in the same orientation."""
    found = []
    for level in press.levels:
        raw = np.asarray(level.raw) - np.asarray(press.free.raw)
        raw_sd = np.hypot(level.raw_sd, press.free.raw_sd)
        joints = np.asarray(level.joints_rad, float)
        found.append(HeldLevel(joints, workcell.pose_base_peg(joints), raw, raw_sd))
    return found


def corners_m(peg: Peg) -> Array:
    """What of the peg can touch a plane first (k, 3), peg frame, m."""
    return np.vstack([peg.outline_m(peg.tip_m), peg.outline_m(peg.taper_start_m)])


def touching_corner(peg: Peg, rotation_base_peg: Array, normal_base: Array) -> tuple[Array, float]:
    """The corner (3,), peg frame, that is farthest along the normal, and by how much it is, m."""
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
