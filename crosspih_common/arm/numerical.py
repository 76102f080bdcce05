"""Inverse kinematics of any arm near a seed, by Newton's method on Pinocchio's kinematics.

Each step solves for the remaining twist with a Levenberg-Marquardt damping. The damping falls with the square of the
error, so that the last steps are Newton steps, also where the solutions form a line. A redundant (seventh) joint goes
to the posture nearest to the seed. A joint that would leave its range is held at its limit, and the other joints solve
without it.

Pinocchio (`pin`): Carpentier et al., "The Pinocchio C++ library", SII 2019. Errors as in `crosspih_common.arm.inverse`.
"""

from __future__ import annotations

import threading
from functools import cached_property

import numpy as np
import pinocchio
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from crosspih_common.arm.errors import Unreachable
from crosspih_common.arm.kinematics import ArmModel
from crosspih_common.geometry.pose import Array, Pose

_CONVERGED_SQUARED = 1e-22  # (1e-11 m and rad)^2
_STEPS = 60
_STEPS_NEAR_SEED = 40  # after these steps only the pose counts, not the distance to the seed
_LARGEST_STEP_RAD = 0.5
_DAMPING = 1e-3
_FAR_RAD = 1.0  # when the posture found is farther than this from the seed, another may be nearer
_STARTS = 24
_SINGULAR = 0.02
_AT_LIMIT_RAD = 1e-6
_BOUNDED_STEPS = 100
_MET_SQUARED = 1e-20  # (1e-10 m and rad)^2


class Numerical:
    """The inverse kinematics of one arm; safe to call from several threads."""

    def __init__(self, arm: ArmModel) -> None:
        self._arm = arm
        self._lower, self._upper = arm.limits.lower_rad, arm.limits.upper_rad
        self._model = model = pinocchio.Model()
        parent = 0
        for index, zero in enumerate(arm.zeros_rad.tolist()):
            before = arm.fixed[index] @ Pose.from_rotvec([0.0, 0.0, zero], [0.0, 0.0, 0.0])
            parent = model.addJoint(parent, pinocchio.JointModelRZ(), _se3(before), f"joint{index + 1}")
        flange = pinocchio.Frame("flange", parent, 0, _se3(arm.fixed[-1]), pinocchio.FrameType.OP_FRAME)
        self._flange = model.addFrame(flange)
        self._own = threading.local()

    def nearest(self, pose_base_flange: Pose, seed_joints_rad: ArrayLike) -> Array:
        """Joint angles (n,), rad, inside the limits near a seed (n,), rad. If the search from the seed fails or ends
        far from it, this is the nearest of the solutions found from a fixed sequence of other starts.

        Raises `Unreachable` that names the remaining error, joints at their limits and singular joints; ValueError for
        a seed that is not n finite numbers.
        """
        seed, target = self._checked(seed_joints_rad), self._target(pose_base_flange)
        first, left = self._descend(target, seed, seed)
        if left is None and np.abs(first - seed).max() < _FAR_RAD:
            return first
        found = [first] if left is None else []
        closest = (np.inf, first) if left is None else (float(left @ left), first)
        for start in self._starts(seed):
            joints, left = self._descend(target, start, seed)
            if left is None:
                found.append(joints)
            elif float(left @ left) < closest[0]:
                closest = float(left @ left), joints
        if not found:
            bounded = self._within_limits(target, seed)
            if bounded is None:
                raise Unreachable(self._why(target, closest[1]))
            found.append(bounded)
        turned = [self._unwound(joints, seed) for joints in found]
        return min(turned, key=lambda joints: float(np.linalg.norm(joints - seed)))

    def follow(self, pose_base_flange: Pose, seed_joints_rad: ArrayLike) -> Array:
        """As `nearest`, from the seed alone: for a pose close to the seed's own."""
        seed, target = self._checked(seed_joints_rad), self._target(pose_base_flange)
        joints, left = self._descend(target, seed, seed)
        if left is not None:
            raise Unreachable(self._why(target, joints))
        return joints

    def singular(self, joints_rad: ArrayLike) -> str:
        """Which joints are nearly singular at joint angles (n,), rad, and the smallest singular value of the Jacobian
        of the flange (m or rad a rad); empty where none are."""
        _, values, rows = np.linalg.svd(self._arm.jacobian(joints_rad))
        if values[-1] > 0.1:
            return ""
        return f"near a singularity of {_joints_of(rows[5])}, smallest singular value {values[-1]:.2g}"

    def _checked(self, seed_joints_rad: ArrayLike) -> Array:
        seed = np.asarray(seed_joints_rad, float)
        if seed.shape != self._lower.shape or not np.isfinite(seed).all():
            raise ValueError(f"seed_joints_rad wants {len(self._lower)} finite angles, got {seed!r}")
        return np.asarray(np.minimum(np.maximum(seed, self._lower), self._upper))

    def _target(self, pose: Pose) -> pinocchio.SE3:
        rotation = pose.rotation
        if not (np.isfinite(rotation).all() and np.isfinite(pose.translation_m).all()):
            raise Unreachable("pose_base_flange holds a number that is not finite")
        crooked = np.abs(rotation.T @ rotation - _EYE3).max()
        if crooked > 1e-6 or np.linalg.det(rotation) < 0.0:
            raise Unreachable("pose_base_flange.rotation is not a proper rotation; build it with Pose.from_matrix")
        return pinocchio.SE3(rotation, pose.translation_m)

    def _missing(self, target: pinocchio.SE3, joints: Array) -> tuple[Array, Array]:
        """The twist (6,) from the present pose to the target, in the flange's frame, and the Jacobian (6, n) there."""
        own = self._own
        if not hasattr(own, "data"):
            own.data = self._model.createData()
        jacobian = pinocchio.computeFrameJacobian(self._model, own.data, joints, self._flange, pinocchio.LOCAL)
        pinocchio.framesForwardKinematics(self._model, own.data, joints)
        return pinocchio.log6(own.data.oMf[self._flange].actInv(target)).vector, jacobian

    def _descend(self, target: pinocchio.SE3, start: Array, seed: Array) -> tuple[Array, Array | None]:
        """Iterate from joint angles (n,) to the target: the last angles, and the remaining twist (6,), None if none."""
        joints, lower, upper = start, self._lower, self._upper
        for count in range(_STEPS):
            missing, jacobian = self._missing(target, joints)
            squared = float(missing @ missing)
            if squared < _CONVERGED_SQUARED:
                return joints, None
            wish = seed - joints if len(joints) > 6 and count < _STEPS_NEAR_SEED else None
            damping = _DAMPING * squared
            step = _solved(jacobian, missing, wish, damping)
            longest = np.abs(step).max()
            if longest > _LARGEST_STEP_RAD:
                step *= _LARGEST_STEP_RAD / longest
            ahead = joints + step
            if (ahead < lower).any() or (ahead > upper).any():
                ahead = self._held(joints, ahead, jacobian, missing, wish, damping)
                if np.abs(ahead - joints).max() < 1e-12:
                    break
            joints = ahead
        return joints, self._missing(target, joints)[0]

    def _within_limits(self, target: pinocchio.SE3, seed: Array) -> Array | None:
        """Bounded least squares: slower, but it also finds poses near several limits at once, where Newton's steps
        with held joints stop early. None if it finds no solution."""

        def left(joints: Array) -> Array:
            return self._missing(target, joints)[0]

        def slope(joints: Array) -> Array:
            # but for that of the twist's logarithm, which is one at the target
            return -self._missing(target, joints)[1]

        result = least_squares(
            left, seed, slope, (self._lower, self._upper), "dogbox",
            xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=_BOUNDED_STEPS,
        )  # fmt: skip
        joints = np.clip(result.x, self._lower, self._upper)
        missing = self._missing(target, joints)[0]
        return joints if float(missing @ missing) < _MET_SQUARED else None

    def _held(
        self, joints: Array, ahead: Array, jacobian: Array, missing: Array, wish: Array | None, damping: float
    ) -> Array:
        """The step with every joint that would leave its range held at the limit, and the others making up for it."""
        held = np.zeros(len(joints), dtype=bool)
        while True:
            held |= (ahead < self._lower) | (ahead > self._upper)
            clipped = np.minimum(np.maximum(ahead, self._lower), self._upper)
            if held.all():
                return np.asarray(clipped)
            rest = missing - jacobian[:, held] @ (clipped - joints)[held]
            step = _solved(jacobian[:, ~held], rest, None if wish is None else wish[~held], damping)
            longest = np.abs(step).max()
            ahead = clipped.copy()
            ahead[~held] = joints[~held] + step * min(1.0, _LARGEST_STEP_RAD / max(longest, 1e-300))
            if not ((ahead < self._lower) | (ahead > self._upper)).any():
                return ahead

    @cached_property
    def _spread(self) -> Array:
        """Where to start again (_STARTS, n), in -1..1, each farther from the seed than those before."""
        from scipy.stats import qmc  # half a second to load, and few targets need it

        unit = qmc.Halton(len(self._lower), scramble=False).random(_STARTS + 1)[1:]
        return (2.0 * unit - 1.0) * np.linspace(0.2, 1.0, _STARTS)[:, None]

    def _starts(self, seed: Array) -> Array:
        low, high = np.maximum(self._lower, seed - np.pi), np.minimum(self._upper, seed + np.pi)
        spread = self._spread
        return np.where(spread > 0.0, seed + spread * (high - seed), seed + spread * (seed - low))

    def _unwound(self, joints: Array, seed: Array) -> Array:
        turned = joints + 2.0 * np.pi * np.round((seed - joints) / (2.0 * np.pi))
        return np.where((turned >= self._lower) & (turned <= self._upper), turned, joints)

    def _why(self, target: pinocchio.SE3, joints: Array) -> str:
        missing, jacobian = self._missing(target, joints)
        text = (
            f"no posture near the seed reaches the pose: the closest one found leaves "
            f"{np.linalg.norm(missing[:3]) * 1e3:.1f} mm and {np.linalg.norm(missing[3:]):.4f} rad"
        )
        for index, value in enumerate(joints.tolist()):
            low, high = float(self._lower[index]), float(self._upper[index])
            if min(value - low, high - value) < _AT_LIMIT_RAD:
                text += f"; joint {index + 1} is at its limit {low if value - low < high - value else high:.4f} rad"
        _, values, rows = np.linalg.svd(jacobian)
        if values[-1] < _SINGULAR:
            text += f"; the arm is singular there: {_joints_of(rows[5])}, smallest singular value {values[-1]:.2g}"
        return text


_EYE3, _EYE6 = np.eye(3), np.eye(6)


def _se3(pose: Pose) -> pinocchio.SE3:
    return pinocchio.SE3(pose.rotation, pose.translation_m)


def _solved(jacobian: Array, missing: Array, wish: Array | None, damping: float) -> Array:
    """The step (m,) that removes a remaining twist (6,) and is otherwise as near to `wish` (m,) as possible."""
    squared = jacobian @ jacobian.T + max(damping, 1e-15) * _EYE6
    if wish is None:
        return np.asarray(jacobian.T @ np.linalg.solve(squared, missing))
    return np.asarray(wish + jacobian.T @ np.linalg.solve(squared, missing - jacobian @ wish))


def _joints_of(direction: Array) -> str:
    """The joints that contribute most to a singular direction (n,)."""
    share = np.abs(direction)
    names = [str(index + 1) for index in np.flatnonzero(share > 0.3 * share.max()).tolist()]
    return f"joint {names[0]}" if len(names) == 1 else f"joints {', '.join(names[:-1])} and {names[-1]}"
