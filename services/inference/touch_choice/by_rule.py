"""The next push by rule, chosen to measure what is still unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Peg

WIDE_LATERAL_SD_M = 5e-4
WIDE_ROTATION_SD_RAD = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class PlannedTouch:
    """The start of a guarded push: the peg's pose with its tip short of the rim, the unit direction in the base frame,
    and its kind: "estimate" (aim at the estimate) or "arm 1" and on (make that part of the outline touch first)."""

    pose_base_peg_start: Pose
    direction_base: Array
    idea: str


@dataclass(frozen=True, slots=True)
class ArmPattern:
    """How far off the estimate an arm touch starts: sideways (m), turned about the axis and tilted (rad).

    The sideways shift puts two opposite arms on a wall, the turn leaves one of them; 1.5 mm over a 14 degree taper is
    6 mm ahead of the body, so that the deflection at the force limit closes no second contact.
    """

    shift_m: float = 0.0015
    turn_rad: float = 0.02
    tilt_rad: float = 0.0
    largest_shift_m: float = 0.004
    largest_turn_rad: float = 0.08


def next_touch(
    peg: Peg,
    pose_base_hole: Pose,
    covariance: Array,
    failed_pushes: int,
    touches_made: int,
    last_touch_used: bool = True,
    standoff_m: float = 0.004,
    pattern: ArmPattern | None = None,
) -> PlannedTouch:
    """The next touch, given the posterior (mean, covariance (6, 6)), how many pushes failed, and the touches so far.

    While the posterior is wide, fewer than two pushes have failed and the last touch could be explained, the push goes
    straight to the estimate, and the errors themselves decide what touches. Otherwise it goes arm by arm, each time the
    next one, so that two touches in a row measure across each other; the turn changes its sense after every round. The
    tip starts `standoff_m` and 2.5 sd of depth short of the rim.
    """
    sd = np.sqrt(np.diag(covariance))
    wide = bool(sd[:2].max() > WIDE_LATERAL_SD_M or sd[3:].max() > WIDE_ROTATION_SD_RAD)
    direction = pose_base_hole.rotation[:, 2].copy()
    standoff_m = standoff_m + 2.5 * float(sd[2])
    if wide and failed_pushes < 2 and last_touch_used:
        start = pose_base_hole @ Pose.from_translation([0.0, 0.0, -standoff_m - peg.tip_m])
        return PlannedTouch(start, direction, "estimate")
    arms = arms_of(peg)
    sense = 1.0 if (touches_made // arms) % 2 == 0 else -1.0
    return arm_touch(peg, pose_base_hole, covariance, touches_made % arms, sense, standoff_m, pattern or ArmPattern())


def arms_of(peg: Peg) -> int:
    """The number of directions in a pattern: one for each rotation that maps the outline onto itself, three to six of
    them; four if there are none or too many."""
    order = peg.outline.symmetry_order
    return order if 3 <= order <= 6 else 4


def arm_touch(
    peg: Peg, pose_base_hole: Pose, covariance: Array, arm: int, sense: float, standoff_m: float, pattern: ArmPattern
) -> PlannedTouch:
    """The touch that lets one part of the outline, counted from +x, touch first, turned one way (1) or other (-1)."""
    sd = np.sqrt(np.diag(covariance))
    # With a wide posterior the shift must exceed the error, within the reach of the taper.
    shift_m = min(pattern.shift_m + float(sd[:2].max()), pattern.largest_shift_m)
    turn_rad = min(pattern.turn_rad + float(sd[5]), pattern.largest_turn_rad)
    azimuth = arm * 2.0 * np.pi / arms_of(peg)
    outward = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    sideways = sense * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    # The tilt is about the rim, so that it does not change the shift.
    turn = Pose.from_rotvec([0.0, 0.0, sense * turn_rad], np.zeros(3))
    tilt = Pose.from_rotvec(pattern.tilt_rad * outward, np.zeros(3))
    offset = Pose.from_translation([*(shift_m * sideways)[:2], -standoff_m]) @ turn @ tilt
    start = pose_base_hole @ offset @ Pose.from_translation([0.0, 0.0, -peg.tip_m])
    return PlannedTouch(start, pose_base_hole.rotation[:, 2].copy(), f"arm {arm + 1}")
