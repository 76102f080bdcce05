"""Closed-form inverse kinematics of a 6R arm with a spherical wrist (the XB4's structure).

The wrist centre fixes joints 1 to 3 (two shoulders, two elbows), the remaining rotation fixes joints 4 to 6 (two
wrists): eight branches, each with its equivalents a full turn away where the limits allow them (Pieper's method;
Siciliano et al., "Robotics: Modelling, Planning and Control", section 2.12).

A single solve works on plain floats, because a controller calls it at every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, atan2, cos, hypot, isfinite, pi, remainder, sin

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.arm.errors import Unreachable
from crosspih_common.arm.kinematics import ArmModel
from crosspih_common.geometry.pose import Array, Pose

Joints = tuple[float, float, float, float, float, float]
Shoulder = tuple[float, float, float]
Hand = tuple[float, float, float, float, float, float, float]

_TURN = 2.0 * pi
_SINGULAR_SINE = 1e-10  # below this sine of joint 5 the error of choosing joint 4 freely stays under 1e-10
_NEAR_SINGULAR_SINE = 0.02
_LIMIT_SLACK_RAD = 1e-9


@dataclass(frozen=True, slots=True)
class _Geometry:
    """The lengths, offsets and limits of an arm that the closed form uses, as plain floats."""

    offsets: Joints
    lower: Joints
    upper: Joints
    d1: float
    a1: float
    a2: float
    d4: float
    d6: float
    forearm: float
    forearm_angle: float


def _six(values: ArrayLike) -> Joints:
    a, b, c, d, e, f = np.asarray(values, float).tolist()
    return a, b, c, d, e, f


def _geometry(arm: ArmModel) -> _Geometry:
    if arm.table is None:
        raise ValueError(f"arm {arm.name!r}: the closed form wants an arm made from a standard DH table")
    dh = arm.table
    twists = np.array([-pi / 2, 0.0, -pi / 2, pi / 2, -pi / 2, 0.0])
    if dh.shape != (6, 4) or not np.allclose(dh[:, 3], twists, atol=1e-12):
        raise ValueError(f"arm {arm.name!r}: the closed form wants DH twists (-90, 0, -90, 90, -90, 0) degrees")
    if np.any(np.abs(dh[[1, 2, 4], 1]) > 0.0) or np.any(np.abs(dh[[3, 4, 5], 2]) > 0.0):
        raise ValueError(f"arm {arm.name!r}: the closed form wants d2 = d3 = d5 = 0 and a4 = a5 = a6 = 0")
    a3, d4 = float(dh[2, 2]), float(dh[3, 1])
    return _Geometry(
        offsets=_six(dh[:, 0]),
        lower=_six(arm.limits.lower_rad),
        upper=_six(arm.limits.upper_rad),
        d1=float(dh[0, 1]),
        a1=float(dh[0, 2]),
        a2=float(dh[1, 2]),
        d4=d4,
        d6=float(dh[5, 1]),
        forearm=hypot(a3, d4),
        forearm_angle=atan2(d4, a3),
    )


def _rows(pose: Pose) -> tuple[list[list[float]], list[float]]:
    rows: list[list[float]] = pose.rotation.tolist()
    position: list[float] = pose.translation_m.tolist()
    (a, b, c), (d, e, f), (g, h, i) = rows
    crooked = max(
        abs(a * a + d * d + g * g - 1.0), abs(b * b + e * e + h * h - 1.0), abs(c * c + f * f + i * i - 1.0),
        abs(a * b + d * e + g * h), abs(a * c + d * f + g * i), abs(b * c + e * f + h * i),
    )  # fmt: skip
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    # the determinant uses all nine entries: it is finite only if they all are
    if not (isfinite(determinant) and isfinite(sum(position))):
        raise Unreachable("pose_base_flange holds a number that is not finite, or one beyond all reach")
    if crooked > 1e-6 or determinant < 0.0:
        raise Unreachable("pose_base_flange.rotation is not a proper rotation; build it with Pose.from_matrix")
    return rows, position


def _shoulders(geometry: _Geometry, wrist: tuple[float, float, float], seed1: float) -> tuple[Shoulder, Shoulder]:
    """(t1, along, down) of both shoulders: where the wrist centre is in the plane of frame 1, x outward, y downward."""
    x, y, z = wrist
    radius, down = hypot(x, y), geometry.d1 - z
    ahead = atan2(y, x) if radius > 1e-12 else seed1 + geometry.offsets[0]
    return (ahead, radius - geometry.a1, down), (ahead + pi, -radius - geometry.a1, down)


def _bend(geometry: _Geometry, along: float, down: float) -> float | None:
    """How far the elbow is bent, 0 to pi, one way or the other; None where the wrist centre is out of reach."""
    a2, forearm = geometry.a2, geometry.forearm
    cosine = (along * along + down * down - a2**2 - forearm**2) / (2.0 * a2 * forearm)
    if abs(cosine) > 1.0 + 1e-12:
        return None
    return acos(max(-1.0, min(1.0, cosine)))


def _arm(geometry: _Geometry, shoulder: Shoulder, elbow: float) -> tuple[float, float, float]:
    """(t1, t2, t3), DH angles with offsets included, for this bend of the elbow."""
    t1, along, down = shoulder
    reach = geometry.forearm * sin(elbow)
    t2 = atan2(down, along) - atan2(reach, geometry.a2 + geometry.forearm * cos(elbow))
    return t1, t2, elbow - geometry.forearm_angle


def _arm_branches(
    geometry: _Geometry, wrist: tuple[float, float, float], seed1: float
) -> list[tuple[float, float, float]]:
    """(t1, t2, t3) of every shoulder and elbow that puts the wrist centre there."""
    branches = []
    for shoulder in _shoulders(geometry, wrist, seed1):
        bend = _bend(geometry, *shoulder[1:])
        if bend is not None:
            branches += [_arm(geometry, shoulder, elbow) for elbow in ((bend, -bend) if bend > 1e-12 else (bend,))]
    return branches


def _in_forearm(rows: list[list[float]], t1: float, t23: float) -> Hand:
    """The flange's rotation in frame 3, given the arm's angles: its first two rows, and the last entry of its third."""
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rows
    c1, s1, c, s = cos(t1), sin(t1), cos(t23), sin(t23)
    # Columns of frame 3 in the base: x3 = (c1 c, s1 c, -s), y3 = (s1, -c1, 0), z3 = (-c1 s, -s1 s, -c).
    x, y = c1 * c, s1 * c
    return (
        x * r00 + y * r10 - s * r20, x * r01 + y * r11 - s * r21, x * r02 + y * r12 - s * r22,
        s1 * r00 - c1 * r10, s1 * r01 - c1 * r11, s1 * r02 - c1 * r12,
        -c1 * s * r02 - s1 * s * r12 - c * r22,
    )  # fmt: skip


def _wrist(hand: Hand, t4: float) -> tuple[float, float, float]:
    """(t4, t5, t6) for a given angle of joint 4."""
    m00, m01, m02, m10, m11, m12, m22 = hand
    c4, s4 = cos(t4), sin(t4)
    t5 = atan2(-(c4 * m02 + s4 * m12), m22)
    # From the row that joint 5 leaves alone: exact also where joints 4 and 6 nearly share an axis.
    return t4, t5, atan2(c4 * m10 - s4 * m00, c4 * m11 - s4 * m01)


def _wrist_branches(
    rows: list[list[float]], t1: float, t23: float, seed4: float
) -> list[tuple[float, float, float, float]]:
    """(t4, t5, t6, abs(sin t5)) of both wrists, given the rotation and the arm's angles."""
    hand = _in_forearm(rows, t1, t23)
    _, _, m02, _, _, m12, _ = hand
    sine = hypot(m02, m12)
    choices = (seed4,) if sine < _SINGULAR_SINE else (atan2(-m12, -m02), atan2(m12, m02))
    return [(*_wrist(hand, t4), sine) for t4 in choices]


def _wrist_centre(geometry: _Geometry, rows: list[list[float]], position: list[float]) -> tuple[float, float, float]:
    (x, y, z), d6 = position, geometry.d6
    return x - d6 * rows[0][2], y - d6 * rows[1][2], z - d6 * rows[2][2]


def _branch_of(geometry: _Geometry, pose: Pose, seed: Joints) -> list[float] | None:
    """The joints (6,) of the seed's own branch; None if another branch may be nearer, or a joint is at its limits.

    Another shoulder or wrist differs by half a turn in joint 1 or 4; another elbow differs by twice the bend in joint
    3. If the answer is within half of the smallest of these distances, no other branch can be nearer.
    """
    rows, position = _rows(pose)
    o1, o2, o3, o4, o5, o6 = geometry.offsets
    ahead, behind = _shoulders(geometry, _wrist_centre(geometry, rows, position), seed[0])
    shoulder = ahead if abs(remainder(ahead[0] - o1 - seed[0], _TURN)) < 0.5 * pi else behind
    bend = _bend(geometry, *shoulder[1:])
    if bend is None:
        return None
    seed_bend = remainder(seed[2] + o3 + geometry.forearm_angle, _TURN)
    t1, t2, t3 = _arm(geometry, shoulder, bend if seed_bend >= 0.0 else -bend)
    hand = _in_forearm(rows, t1, t2 + t3)
    _, _, m02, _, _, m12, _ = hand
    if hypot(m02, m12) < _SINGULAR_SINE:
        return None
    t4 = atan2(-m12, -m02)
    if abs(remainder(t4 - o4 - seed[3], _TURN)) >= 0.5 * pi:
        t4 = atan2(m12, m02)
    t4, t5, t6 = _wrist(hand, t4)
    chosen, squared = [], 0.0
    for value, wanted, low, high in zip(
        (t1 - o1, t2 - o2, t3 - o3, t4 - o4, t5 - o5, t6 - o6), seed, geometry.lower, geometry.upper, strict=True
    ):
        angle = value + _TURN * round((wanted - value) / _TURN)
        if not low - _LIMIT_SLACK_RAD <= angle <= high + _LIMIT_SLACK_RAD:
            return None
        squared += (angle - wanted) ** 2
        chosen.append(angle)
    return chosen if squared < (0.5 * min(bend, pi - bend, 0.5 * pi)) ** 2 else None


def _branches(geometry: _Geometry, pose: Pose, seed: Joints) -> list[tuple[Joints, float]]:
    """Every branch before limits: (joint angles, abs(sin of joint 5))."""
    rows, position = _rows(pose)
    wrist = _wrist_centre(geometry, rows, position)
    arms = _arm_branches(geometry, wrist, seed[0])
    if not arms:
        raise Unreachable(_out_of_reach(geometry, wrist))
    o1, o2, o3, o4, o5, o6 = geometry.offsets
    return [
        ((t1 - o1, t2 - o2, t3 - o3, t4 - o4, t5 - o5, t6 - o6), sine)
        for t1, t2, t3 in arms
        for t4, t5, t6, sine in _wrist_branches(rows, t1, t2 + t3, seed[3] + o4)
    ]


def _out_of_reach(geometry: _Geometry, wrist: tuple[float, float, float]) -> str:
    radius, height = hypot(wrist[0], wrist[1]), wrist[2] - geometry.d1
    spans = [hypot(radius - geometry.a1, height), hypot(radius + geometry.a1, height)]
    longest, shortest = geometry.a2 + geometry.forearm, abs(geometry.a2 - geometry.forearm)
    if min(spans) > longest:
        return (
            f"the pose is {(min(spans) - longest) * 1e3:.1f} mm beyond reach (the wrist centre would be "
            f"{min(spans) * 1e3:.1f} mm from the shoulder, the arm spans {longest * 1e3:.1f} mm)"
        )
    return (
        f"the pose is {(shortest - min(spans)) * 1e3:.1f} mm too close (the wrist centre would be "
        f"{min(spans) * 1e3:.1f} mm from the shoulder, the folded arm keeps {shortest * 1e3:.1f} mm)"
    )


def _equivalents(value: float, low: float, high: float) -> list[float]:
    """All angles inside the limits that differ from a value by whole turns, ascending."""
    turns = -int((value - low + _LIMIT_SLACK_RAD) // _TURN)
    angle = value + turns * _TURN
    found = []
    while angle <= high + _LIMIT_SLACK_RAD:
        found.append(angle)
        angle += _TURN
    return found


def _outside(geometry: _Geometry, branches: list[tuple[Joints, float]]) -> str:
    """Which joint forbids the pose, on the branch that comes closest to the limits."""
    best: tuple[float, str] | None = None
    for joints, sine in branches:
        worst, lines = 0.0, []
        for index, value in enumerate(joints):
            low, high = geometry.lower[index], geometry.upper[index]
            if _equivalents(value, low, high):
                continue
            near = min(
                (value + turn * _TURN for turn in (-2, -1, 0, 1, 2)),
                key=lambda angle, low=low, high=high: max(low - angle, angle - high),  # type: ignore[misc]
            )
            worst = max(worst, low - near, near - high)
            lines.append(f"joint {index + 1} at {near:.4f} rad is outside [{low:.4f}, {high:.4f}]")
        note = "; the wrist is singular here: joints 4 and 6 turn about one line" if sine < _NEAR_SINGULAR_SINE else ""
        if best is None or worst < best[0]:
            best = (worst, "; ".join(lines) + note)
    assert best is not None
    return f"the pose is outside the limits on each of {len(branches)} branches; on the closest, {best[1]}"


class ClosedForm:
    """The inverse kinematics of one arm; ValueError for an arm of another structure."""

    def __init__(self, arm: ArmModel) -> None:
        self._geometry = _geometry(arm)

    def solutions(self, pose_base_flange: Pose) -> list[Array]:
        """Every joint vector (6,), rad, inside the limits that puts the flange at a pose, in lexicographic order.

        Up to eight branches and their equivalents a full turn away; empty when only the limits forbid the pose. At a
        wrist singularity joint 4 is free and taken as 0, on a line through axis 1 joint 1 likewise.

        Raises `Unreachable` for a pose out of the arm's reach or not a rigid pose.
        """
        geometry = self._geometry
        found: set[Joints] = set()
        for joints, _ in _branches(geometry, pose_base_flange, (0.0,) * 6):
            ranges = [_equivalents(v, lo, hi) for v, lo, hi in zip(joints, geometry.lower, geometry.upper, strict=True)]
            vectors: list[tuple[float, ...]] = [()]
            for options in ranges:
                vectors = [(*vector, option) for vector in vectors for option in options]
            found.update(_six(vector) for vector in vectors)
        return [np.array(joints) for joints in sorted(found)]

    def nearest(self, pose_base_flange: Pose, seed_joints_rad: ArrayLike) -> Array:
        """The joint vector (6,), rad, inside the limits nearest (Euclidean) to a seed (6,), rad, for a flange pose.

        Where joints 4 and 6 share an axis, joint 4 keeps the seed's angle. Raises `Unreachable` naming the distance
        beyond reach, or the joint and limit that forbid the pose; ValueError for a seed that is not six finite numbers.
        """
        geometry = self._geometry
        seed = _checked_seed(seed_joints_rad)
        branches = _branches(geometry, pose_base_flange, seed)
        best, best_cost = None, float("inf")
        for joints, _ in branches:
            cost, chosen = 0.0, []
            for value, wanted, low, high in zip(joints, seed, geometry.lower, geometry.upper, strict=True):
                angle = value + _TURN * round((wanted - value) / _TURN)
                if not low - _LIMIT_SLACK_RAD <= angle <= high + _LIMIT_SLACK_RAD:
                    options = _equivalents(value, low, high)
                    if not options:
                        break
                    angle = min(options, key=lambda option, wanted=wanted: abs(option - wanted))  # type: ignore[misc]
                cost += (angle - wanted) ** 2
                chosen.append(angle)
            else:
                if cost < best_cost:
                    best, best_cost = chosen, cost
        if best is None:
            raise Unreachable(_outside(geometry, branches))
        return np.array(best)

    def follow(self, pose_base_flange: Pose, seed_joints_rad: ArrayLike) -> Array:
        """The same result as `nearest`, bit for bit, but faster: near the seed's pose it computes one branch.

        A controller calls this every few milliseconds.
        """
        seed = _checked_seed(seed_joints_rad)
        joints = _branch_of(self._geometry, pose_base_flange, seed)
        return self.nearest(pose_base_flange, seed) if joints is None else np.array(joints)

    def singular(self, joints_rad: ArrayLike) -> str:
        """Whether the wrist is nearly singular, in words; empty where it is not."""
        sine = abs(sin(float(np.asarray(joints_rad, float)[4]) + self._geometry.offsets[4]))
        return "near the wrist singularity" if sine < 0.2 else ""


def _checked_seed(seed_joints_rad: ArrayLike) -> Joints:
    seed = np.asarray(seed_joints_rad, float)
    if seed.shape != (6,) or not isfinite(sum(seed.tolist())):
        raise ValueError(f"seed_joints_rad wants six finite angles, got {seed!r}")
    return _six(seed)
