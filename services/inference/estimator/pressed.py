"""The hole's pose from presses against the walls of its bore, with the peg's body already inside.

In the bore several contacts press at once: flat walls against flat sides, at the rim and at the body's leading end.
Which of them press does not have to be guessed. Inside the clearance everything is linear: a wall point j has the gap
g_j = c + a_j . q, q = (x, y, rx, ry, rz) of the peg against the centred one, and presses with f_j >= 0 along the same
a_j. With walls of a high but finite stiffness k both become one equation, f_j = k s log(1 + exp(-g_j / s)), whose width
s shrinks from half the clearance to nearly zero. Least squares over the hole's pose and a small error of each press's
own pose then matches all wrenches; walls that are not felt keep the peg out of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import expit

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import transform_wrench
from crosspih_common.shapes import Hole, Peg
from services.inference.estimator.bore import PLANE, BoreWalls
from services.inference.estimator.observation import HolePosePrior, TouchObservation

# of the unknowns: the depth last, because only the rim's place along the peg depends on it
ORDER = np.array([0, 1, 3, 4, 5, 2])


@dataclass(frozen=True, slots=True)
class PressSettings:
    """How far the model is trusted.

    wall_stiffness_n_m: high against the arm's; widths_m: softness of the walls, one fit each. pose_sd_m, pose_sd_rad:
    error of a press's own pose (elastic arm, creep); common_sd_m, common_sd_rad: error common to all presses.
    force_sd_n, moment_sd_nm: floors of a wrench; friction_share: added for friction in unknown directions, of |F|, at
    lever_m.
    gate: mean square beyond which a press counts as not explained.
    """

    wall_stiffness_n_m: float = 2e6
    widths_m: tuple[float, ...] = (5e-5, 2e-5, 1e-5, 5e-6, 2e-6)
    pose_sd_m: float = 6e-6
    pose_sd_rad: float = 2e-4
    common_sd_m: float = 2e-6
    common_sd_rad: float = 2e-4
    force_sd_n: float = 0.05
    moment_sd_nm: float = 0.003
    friction_share: float = 0.1
    lever_m: float = 0.02
    gate: float = 9.0

    @classmethod
    def of(cls, contact_stiffness_n_m: float | None) -> PressSettings:
        """For walls with the declared stiffness, N/m; None: rigid walls."""
        return cls() if contact_stiffness_n_m is None else cls(wall_stiffness_n_m=min(2e6, contact_stiffness_n_m))


@dataclass(frozen=True, slots=True, eq=False)
class PressedEstimate:
    """pose_base_hole and covariance (6, 6), right perturbation, m and rad; costs: mean square residual of each press
    (its pose error and wrench, five numbers each); used: False for a press that was left out, with the cost that
    excluded it."""

    pose_base_hole: Pose
    covariance: Array
    costs: tuple[float, ...]
    used: tuple[bool, ...]


def pressed_estimate(
    peg: Peg,
    hole: Hole,
    prior: HolePosePrior,
    presses: Sequence[TouchObservation],
    settings: PressSettings | None = None,
) -> PressedEstimate:
    """The hole's pose from at least one press. Linear about the prior's mean, which must be within the clearance of
    the truth up to some tenths of a millimetre and a degree, as the seat's is (`final_estimate`).

    The worst press is left out, one after the other, while its cost is beyond the gate.
    Raises ValueError when there is no press or the body is not in the bore.
    """
    if not presses:
        raise ValueError("pressed_estimate wants at least one press")
    settings = settings or PressSettings()
    kept = list(range(len(presses)))
    costs = np.zeros(len(presses))
    while True:
        bore = _Bore.of(peg, hole, prior, [presses[index] for index in kept], settings)
        pose, covariance, costs[kept] = bore.fitted(prior)
        worst = kept[int(np.argmax(costs[kept]))]
        if costs[worst] <= settings.gate or len(kept) == 1:
            break
        kept.remove(worst)
    used = tuple(index in kept and bool(costs[index] <= settings.gate) for index in range(len(presses)))
    if not any(used):
        pose, covariance = prior.pose_base_hole, np.asarray(prior.covariance, float)
    else:
        # a fit worse than its noise is trusted less (Birge 1932)
        covariance = covariance * max(1.0, float(np.mean(costs[kept])))
        # Against the truth, presses do not improve the depth, so their information on it is not used.
        keep = np.ones(6)
        keep[2] = max(1.0, float(np.sqrt(np.asarray(prior.covariance)[2, 2] / covariance[2, 2])))
        covariance = covariance * np.outer(keep, keep)
        # errors common to all presses do not average out
        covariance = covariance + np.diag(np.repeat(np.square([settings.common_sd_m, settings.common_sd_rad]), 3))
    return PressedEstimate(pose, covariance, tuple(float(cost) for cost in costs), used)


@dataclass(frozen=True, slots=True, eq=False)
class _Bore:
    """The presses about the middle of the entered body, where translation and rotation hardly mix, hole frame.

    middle_m: its height; points (J, 5) with their clearances_m (J,); displaced (T, 5): the peg against the prior's
    mean; wrenches and their sds (T, 5).
    """

    middle_m: float
    points: Array
    clearances_m: Array
    displaced: Array
    wrenches: Array
    wrench_sd: Array
    settings: PressSettings

    @classmethod
    def of(
        cls, peg: Peg, hole: Hole, prior: HolePosePrior, presses: Sequence[TouchObservation],
        settings: PressSettings,
    ) -> _Bore:  # fmt: skip
        into_hole = prior.pose_base_hole.inverse()
        poses = [into_hole @ press.deflected_pose_base_peg() for press in presses]
        leading = float(np.mean([pose.apply([0.0, 0.0, peg.taper_start_m])[2] for pose in poses]))
        if leading <= hole.chamfer_m:
            raise ValueError(f"the peg's body is {(hole.chamfer_m - leading) * 1e3:.1f} mm short of the bore")
        middle_m = 0.5 * (hole.chamfer_m + leading)
        walls = BoreWalls.of(peg, hole)
        # each first point of a pair is at the rim, the second at the body's leading end
        points = np.stack([walls.points(hole.chamfer_m), walls.points(leading)], axis=1).reshape(-1, 5)
        points[:, 2] += middle_m * points[:, 1]
        points[:, 3] -= middle_m * points[:, 0]
        to_middle = Pose.from_translation([0.0, 0.0, -middle_m])
        wrenches = np.array(
            [
                transform_wrench(to_middle @ pose, press.wrench_peg)[PLANE]
                for pose, press in zip(poses, presses, strict=True)
            ]
        )
        friction = np.linalg.norm(wrenches[:, :2], axis=1) * settings.friction_share
        force_sd = np.hypot(settings.force_sd_n, friction)
        moment_sd = np.hypot(settings.moment_sd_nm, friction * settings.lever_m)
        return cls(
            middle_m,
            points,
            np.repeat(walls.clearances_m, 2),
            np.array([_displacement(pose, middle_m) for pose in poses]),
            wrenches,
            np.column_stack([force_sd, force_sd, moment_sd, moment_sd, moment_sd]),
            settings,
        )

    def fitted(self, prior: HolePosePrior) -> tuple[Pose, Array, Array]:
        """The hole's pose, its covariance (6, 6), and the cost of each press (T,)."""
        to_middle = np.eye(6)
        to_middle[0, 4], to_middle[1, 3] = self.middle_m, -self.middle_m
        covariance = (to_middle @ np.asarray(prior.covariance, float) @ to_middle.T)[np.ix_(ORDER, ORDER)]
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        scale = np.sqrt(np.diag(covariance))
        count = len(self.wrenches)
        unknown = np.zeros(6 + 5 * count)
        for width in self.settings.widths_m:
            unknown = self._solved(unknown, whiten, scale, width)
        rest, jacobian = self._residual(unknown, whiten, scale, self.settings.widths_m[-1])
        free = np.zeros((6, 6))
        free[np.ix_(ORDER, ORDER)] = np.linalg.inv(jacobian.T @ jacobian)[:6, :6] * np.outer(scale, scale)
        back = np.linalg.inv(to_middle)
        move = np.zeros(6)
        move[ORDER] = unknown[:6] * scale
        middle = Pose.from_translation([0.0, 0.0, self.middle_m])
        pose = prior.pose_base_hole @ middle @ Pose.from_rotvec(move[3:], move[:3]) @ middle.inverse()
        costs = np.square(rest[6:].reshape(2, count, 5)).sum(axis=(0, 2)) / 5.0
        return pose, np.asarray(back @ free @ back.T), costs

    def _solved(self, unknown: Array, whiten: Array, scale: Array, width_m: float) -> Array:
        def residual(x: Array) -> Array:
            return self._residual(x, whiten, scale, width_m)[0]

        def jacobian(x: Array) -> Array:
            return self._residual(x, whiten, scale, width_m)[1]

        fit = least_squares(residual, unknown, jac=jacobian, max_nfev=40)
        return np.asarray(fit.x)

    def _residual(self, unknown: Array, whiten: Array, scale: Array, width_m: float) -> tuple[Array, Array]:
        """Residuals (6 + 10 T,) and Jacobian: prior, errors of the presses' poses, wrenches; `unknown` in sds."""
        settings = self.settings
        count = len(self.wrenches)
        pose_sd = np.array([settings.pose_sd_m] * 2 + [settings.pose_sd_rad] * 3)
        moved = unknown[:6] * scale
        slips = unknown[6:].reshape(count, 5)
        off = self.displaced + slips * pose_sd - moved[:5]
        # The first point of each pair, at the rim, moves with the hole; the second moves with the peg.
        deeper = np.zeros_like(self.points)
        deeper[::2, 2], deeper[::2, 3] = -self.points[::2, 1], self.points[::2, 0]
        points = self.points + moved[5] * deeper
        gap = self.clearances_m + off @ points.T
        force = settings.wall_stiffness_n_m * width_m * np.logaddexp(0.0, -gap / width_m)
        misfit = (force @ points - self.wrenches) / self.wrench_sd
        stiffness = settings.wall_stiffness_n_m * expit(-gap / width_m)
        slope = -np.einsum("tj,ji,jk->tik", stiffness, points, points) / self.wrench_sd[:, :, None]
        by_depth = (force @ deeper - (stiffness * (off @ deeper.T)) @ points) / self.wrench_sd
        jacobian = np.zeros((6 + 10 * count, 6 + 5 * count))
        jacobian[:6, :6] = whiten * scale
        jacobian[6 : 6 + 5 * count, 6:] = np.eye(5 * count)
        for index in range(count):
            rows = slice(6 + 5 * (count + index), 11 + 5 * (count + index))
            jacobian[rows, :5] = -slope[index] * scale[:5]
            jacobian[rows, 5] = by_depth[index] * scale[5]
            jacobian[rows, 6 + 5 * index : 11 + 5 * index] = slope[index] * pose_sd
        return np.concatenate([whiten @ moved, slips.ravel(), misfit.ravel()]), jacobian


def _displacement(pose_hole_peg: Pose, middle_z_m: float) -> Array:
    """(5,): the peg's offset from the hole's axis at a height, m, and its rotation, rad."""
    turned = pose_hole_peg.rotvec_rad()
    rim = pose_hole_peg.inverse().apply([0.0, 0.0, middle_z_m])[2]
    return np.concatenate([pose_hole_peg.apply([0.0, 0.0, float(rim)])[:2], turned])
