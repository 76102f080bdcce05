"""Forward kinematics, Jacobian and limits of an arm of revolute joints.

The arm is a chain of fixed poses with a rotation about z between each two of them. Standard DH tables, modified DH
tables and URDF chains can all be written exactly in this form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array, Pose

FEWEST_JOINTS, MAX_JOINTS = 6, 7
LINK_RADIUS_M = 0.07


@dataclass(frozen=True, slots=True, eq=False)
class JointLimits:
    """Limits of every joint, each (n,): rad, rad/s, rad/s^2."""

    lower_rad: Array
    upper_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array

    def __post_init__(self) -> None:
        for name in ("lower_rad", "upper_rad", "speed_rad_s", "acceleration_rad_s2"):
            value = np.asarray(getattr(self, name), float)
            if value.ndim != 1 or value.shape != np.shape(self.lower_rad) or not np.all(np.isfinite(value)):
                raise ValueError(f"{name} wants one finite number a joint ({np.size(self.lower_rad)}), got {value}")
            object.__setattr__(self, name, value)
        if not np.all(self.lower_rad < self.upper_rad):
            joint = int(np.argmin(self.upper_rad - self.lower_rad)) + 1
            raise ValueError(f"lower_rad of joint {joint} is not below its upper_rad")
        if not (np.all(self.speed_rad_s > 0.0) and np.all(self.acceleration_rad_s2 > 0.0)):
            raise ValueError("speed_rad_s and acceleration_rad_s2 want numbers above 0")

    def violations(self, joints_rad: ArrayLike, slack_rad: float = 1e-9) -> list[str]:
        """One line for each joint that is outside its range or not finite; empty when all are inside."""
        joints = np.asarray(joints_rad, float)
        if joints.shape != self.lower_rad.shape:
            return [f"joints_rad wants {len(self.lower_rad)} numbers, got shape {joints.shape}"]
        if bool(np.all((joints >= self.lower_rad - slack_rad) & (joints <= self.upper_rad + slack_rad))):
            return []
        lines = []
        for index, value in enumerate(joints):
            low, high = self.lower_rad[index], self.upper_rad[index]
            if not np.isfinite(value):
                lines.append(f"joint {index + 1} is {value}, want a finite angle")
            elif not low - slack_rad <= value <= high + slack_rad:
                lines.append(f"joint {index + 1} at {value:.4f} rad is outside [{low:.4f}, {high:.4f}]")
        return lines


@dataclass(frozen=True, slots=True, eq=False)
class ArmModel:
    """An arm of 6 or 7 revolute joints, from base {S} to flange.

    `fixed` holds n + 1 poses, `zeros_rad` (n,) the offset that is added to each joint's angle:
    ``pose_base_flange(q) = fixed[0] Rz(q[0] + zeros[0]) fixed[1] Rz(q[1] + zeros[1]) ... fixed[n]``. `table` is the
    standard DH table (n, 4) where the arm was made from one.

    Each link is about a capsule: `link_radii_m` (n,), and `link_lines_m` (n, 2, 3) the two ends of its middle line in
    its own frame, ``link_poses(q)[k + 1]`` for link k; from the previous frame's origin to its own where not given.

    ValueError where the shapes do not agree or the joints are not 6 or 7.
    """

    name: str
    fixed: tuple[Pose, ...]
    zeros_rad: Array
    limits: JointLimits
    link_radii_m: Array = field(default_factory=lambda: np.zeros(0))
    link_lines_m: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    table: Array | None = None
    _turns: Array = field(init=False, repr=False)
    _steps: Array = field(init=False, repr=False)
    _places: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        zeros = np.asarray(self.zeros_rad, float)
        count = len(zeros)
        if not FEWEST_JOINTS <= count <= MAX_JOINTS:
            raise ValueError(f"arm {self.name!r} has {count} joints, want {FEWEST_JOINTS} or {MAX_JOINTS}")
        if len(self.fixed) != count + 1 or self.limits.lower_rad.shape != (count,):
            raise ValueError(
                f"arm {self.name!r} of {count} joints wants {count + 1} fixed poses and limits of {count} joints, "
                f"got {len(self.fixed)} and {len(self.limits.lower_rad)}"
            )
        radii = np.asarray(self.link_radii_m, float)
        radii = radii if radii.size else np.full(count, LINK_RADIUS_M)
        lines = np.asarray(self.link_lines_m, float)
        if not lines.size:
            # the previous origin lies on the axis of joint k, so it stays fixed in the rotated frame
            lines = np.array([[pose.inverse().translation_m, np.zeros(3)] for pose in self.fixed[1:]])
        if radii.shape != (count,) or not np.all(radii > 0.0):
            raise ValueError(f"link_radii_m wants {count} numbers above 0, got {radii}")
        if lines.shape != (count, 2, 3) or not np.all(np.isfinite(lines)):
            raise ValueError(f"link_lines_m wants shape ({count}, 2, 3) and finite numbers, got {lines.shape}")
        steps = np.array([pose.rotation for pose in self.fixed])
        places = np.array([pose.translation_m for pose in self.fixed])
        derived = {"zeros_rad": zeros, "link_radii_m": radii, "link_lines_m": lines}
        derived |= {"_turns": np.eye(3)[None].repeat(count, axis=0), "_steps": steps, "_places": places}
        for name, value in derived.items():
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    @classmethod
    def from_dh(
        cls,
        name: str,
        table: ArrayLike,
        limits: JointLimits,
        *,
        link_radii_m: ArrayLike = (),
        link_lines_m: ArrayLike = (),
    ) -> ArmModel:
        """From a standard DH table (n, 4) of (theta offset, d, a, alpha), rad and m, from the base {S} to the flange.

        Each link's transform is Rz(q + offset) Tz(d) Tx(a) Rx(alpha) (Craig/Spong standard convention).
        """
        rows = _table(name, table)
        fixed = [Pose.identity()]
        fixed += [Pose(_about_x(alpha), np.array([a, 0.0, d])) for _, d, a, alpha in rows]
        return cls(
            name, tuple(fixed), rows[:, 0].copy(), limits, np.asarray(link_radii_m, float),
            np.asarray(link_lines_m, float), rows,
        )  # fmt: skip

    @classmethod
    def from_modified_dh(
        cls,
        name: str,
        table: ArrayLike,
        limits: JointLimits,
        *,
        pose_last_flange: Pose | None = None,
        link_radii_m: ArrayLike = (),
        link_lines_m: ArrayLike = (),
    ) -> ArmModel:
        """From a modified DH table (n, 4), the columns in the same order: theta offset, d, a, alpha.

        Each link's transform is Rx(alpha) Tx(a) Rz(q + offset) Tz(d) (Craig, "Introduction to Robotics", chapter 3);
        `pose_last_flange` is the flange in the last of these frames.
        """
        rows = _table(name, table)
        before = [Pose(_about_x(alpha), np.array([a, 0.0, 0.0])) for _, _, a, alpha in rows]
        along = [Pose.from_translation([0.0, 0.0, d]) for d in rows[:, 1].tolist()]
        flange = Pose.identity() if pose_last_flange is None else pose_last_flange
        fixed = [before[0], *(a @ b for a, b in zip(along, [*before[1:], flange], strict=True))]
        return cls(
            name, tuple(fixed), rows[:, 0].copy(), limits, np.asarray(link_radii_m, float),
            np.asarray(link_lines_m, float),
        )  # fmt: skip

    def changed(self, limits: Mapping[str, ArrayLike], link_radii_m: ArrayLike = ()) -> ArmModel:
        """The same arm with some limits replaced, by the names of `JointLimits`, and with link radii where given.

        ValueError where a limit has not one number a joint.
        """
        for name, value in limits.items():
            if np.shape(value) != (self.joints,):
                raise ValueError(f"{name} wants {self.joints} numbers for the arm {self.name!r}, got {np.size(value)}")
        radii = np.asarray(link_radii_m, float)
        return replace(
            self,
            limits=replace(self.limits, **{name: np.asarray(value, float) for name, value in limits.items()}),
            link_radii_m=radii if radii.size else self.link_radii_m,
        )

    @property
    def joints(self) -> int:
        """How many joints the arm has."""
        return len(self.zeros_rad)

    @property
    def dh(self) -> Array:
        """The standard DH table (n, 4) that the arm was made from; ValueError where it was made from something else."""
        if self.table is None:
            raise ValueError(f"arm {self.name!r} was not made from a standard DH table; use its fixed poses")
        return self.table

    def _turned(self, joints_rad: ArrayLike) -> tuple[Array, Array]:
        """The rotation of every joint (n, 3, 3), and its product with the fixed rotation after it (n, 3, 3)."""
        angles = np.asarray(joints_rad, float) + self.zeros_rad
        if angles.shape != self.zeros_rad.shape:
            raise ValueError(f"joints_rad wants {self.joints} angles, got {angles.shape}")
        cosine, sine = np.cos(angles), np.sin(angles)
        turns = self._turns.copy()
        turns[:, 0, 0] = turns[:, 1, 1] = cosine
        turns[:, 1, 0], turns[:, 0, 1] = sine, -sine
        return turns, turns @ self._steps[1:]

    def frames(self, joints_rad: ArrayLike) -> tuple[Array, Array]:
        """Rotations (n + 1, 3, 3) and positions (n + 1, 3), m, of the frames of `link_poses`, in the base frame."""
        turns, steps = self._turned(joints_rad)
        places = (turns @ self._places[1:, :, None])[:, :, 0]
        rotations, positions = np.empty_like(self._steps), np.empty_like(self._places)
        rotation, position = self._steps[0], self._places[0]
        rotations[0], positions[0] = rotation, position
        for index in range(len(steps)):
            position = position + rotation @ places[index]
            rotation = rotation @ steps[index]
            rotations[index + 1], positions[index + 1] = rotation, position
        return rotations, positions

    def link_poses(self, joints_rad: ArrayLike) -> list[Pose]:
        """`pose_base_link` of the n + 1 frames 0 (base) to n (flange) at joint angles (n,), rad.

        Frame k is moved by the first k joints; the z axis of each but the last is the axis of joint k + 1. They are the
        DH frames of an arm that was made from a standard DH table.
        """
        rotations, positions = self.frames(joints_rad)
        return [Pose(rotation, position) for rotation, position in zip(rotations, positions, strict=True)]

    def pose_base_flange(self, joints_rad: ArrayLike) -> Pose:
        """Forward kinematics: the flange in the base frame {S} at joint angles (n,), rad."""
        rotations, positions = self.frames(joints_rad)
        return Pose(rotations[-1], positions[-1])

    def jacobian(self, joints_rad: ArrayLike, pose_flange_point: Pose | None = None) -> Array:
        """The geometric Jacobian (6, n) in the base frame: rows vx vy vz wx wy wz, of a point fixed to the flange."""
        rotations, positions = self.frames(joints_rad)
        tip = positions[-1]
        if pose_flange_point is not None:
            tip = rotations[-1] @ pose_flange_point.translation_m + tip
        axes = rotations[:-1, :, 2]
        arms = tip - positions[:-1]
        jacobian = np.empty((6, self.joints))
        jacobian[0] = axes[:, 1] * arms[:, 2] - axes[:, 2] * arms[:, 1]
        jacobian[1] = axes[:, 2] * arms[:, 0] - axes[:, 0] * arms[:, 2]
        jacobian[2] = axes[:, 0] * arms[:, 1] - axes[:, 1] * arms[:, 0]
        jacobian[3:] = axes.T
        return jacobian

    def points_base_m(self, joints_rad: ArrayLike, point_flange_m: ArrayLike) -> Array:
        """Where a point (3,) fixed to the flange is, (k, 3), m, base frame, at each of joint angles (k, n), rad."""
        angles = np.asarray(joints_rad, float) + self.zeros_rad
        points = np.broadcast_to(np.asarray(point_flange_m, float), (len(angles), 3))
        for index in range(self.joints, 0, -1):
            x, y, z = (points @ self._steps[index].T + self._places[index]).T
            cosine, sine = np.cos(angles[:, index - 1]), np.sin(angles[:, index - 1])
            points = np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)
        return np.asarray(points @ self._steps[0].T + self._places[0])


def _about_x(angle_rad: float) -> Array:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])


def _table(name: str, table: ArrayLike | Sequence[Sequence[float]]) -> Array:
    rows = np.array(table, float)
    if rows.ndim != 2 or rows.shape[1] != 4 or not np.all(np.isfinite(rows)):
        raise ValueError(f"arm {name!r}: a DH table wants rows of (theta offset, d, a, alpha), got shape {rows.shape}")
    rows.setflags(write=False)
    return rows
