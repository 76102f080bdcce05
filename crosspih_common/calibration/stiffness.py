"""The joints' stiffness from gentle pushes against something rigid: the travel of the motor side against the rise of
the force.

Between two depths of a push the tip stays where it is along the normal n,

    n . J_c dq = - sum_j c_j (n . J_cj) (J_j^T dW)

with dq by the encoders, dW the change of the wrench on the peg, J_c the Jacobian of the corner that touches and c_j one
over the stiffness of joint j (Salisbury 1980, C = J K^-1 J^T). Each step gives one equation, linear in the c_j. A joint
that no push loads keeps its previous stiffness, because the data do not determine it; the answer names such joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from crosspih_common.calibration.fitting import CalibrationRefused, GroupedFit, fit_groups, held_out_folds
from crosspih_common.calibration.presses import (
    Pressed,
    held,
    jacobian_at,
    require,
    touching_corner,
    wrench_base,
)
from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array

PRIOR_SD = 0.7  # of the logarithm of a joint's stiffness relative to the cell's file: half to twice
TAKEN_SD = 0.05  # a joint's stiffness is accepted when its standard deviation is smaller than this
PLAUSIBLE = (0.1, 10.0)
MIN_CHANGE_N = 2.0
FIRST_M, MIN_M = 1e-6, 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class StiffnessFit:
    """stiffness_nm_rad (n,) of each joint, its sd and half 95 % interval as shares of it. taken (n,): whether the
    pushes fix it. The tool's stiffness along the plate's normal in the first posture, N/m, with the same. Residual and
    held-out error of the pushes' equations, m."""

    stiffness_nm_rad: Array
    sd_share: Array
    half_share: Array
    taken: tuple[bool, ...]
    tool_n_m: float
    tool_half_share: float
    rms_m: float
    held_out_m: float
    moved_m: float
    fit: GroupedFit
    missing: tuple[str, ...]
    doubts: tuple[str, ...]


def equations(pressed: Pressed, workcell: Workcell) -> tuple[Array, Array, Array]:
    """(m, n) factors of the c_j, (m,) their right side, m, and (m,) the push of each equation: see the module."""
    normal, peg = np.asarray(pressed.normal_base, float), workcell.peg.shape()
    rows, moved, groups = [], [], []
    soft = 0.0 if workcell.contact_stiffness_n_m is None else 1.0 / workcell.contact_stiffness_n_m
    for index, press in enumerate(pressed.presses):
        levels = held(press, workcell)
        corner, _ = touching_corner(peg, levels[0].pose_base_peg.rotation, normal)
        for before, after in pairwise(levels):
            middle = 0.5 * (before.joints_rad + after.joints_rad)
            change = wrench_base(after, workcell) - wrench_base(before, workcell)
            if abs(float(change[:3] @ normal)) < MIN_CHANGE_N:
                continue
            along = normal @ jacobian_at(workcell, middle, corner)
            torque = workcell.arm().jacobian(middle, workcell.pose_flange_peg()).T @ change
            gone = float(normal @ (after.pose_base_peg.apply(corner) - before.pose_base_peg.apply(corner)))
            rows.append(-along * torque)
            moved.append(gone + soft * float(change[:3] @ normal))
            groups.append(index)
    return np.array(rows), np.array(moved), np.array(groups)


def _fitted(factors: Array, moved: Array, group: NDArray[np.int64], before: Array) -> tuple[GroupedFit, float]:
    """The logarithms of the stiffness ratio to the previous values, and the error of an equation, m."""
    joints, unit_m = len(before), FIRST_M
    own = np.zeros((int(group.max()) + 1, 0))
    for _ in range(2):

        def residual(shared: Array, _: Array, unit_m: float = unit_m) -> Array:
            return np.asarray((factors @ (np.exp(-shared) / before) - moved) / unit_m)

        fit = fit_groups(
            residual, np.zeros(joints), own, group, np.full(joints, 1e-4), np.zeros(0), np.full(joints, PRIOR_SD)
        )
        used, unit_m = unit_m, max(fit.rms * unit_m * np.sqrt(len(moved) / max(len(moved) - joints, 1)), MIN_M)
    return fit, used


def fit_stiffness(pressed: Pressed, workcell: Workcell, folds: int = 5) -> StiffnessFit:
    """Fit the stiffness. Raises CalibrationRefused if the pushes are too few, too gentle, or load no joint enough."""
    require(pressed)
    factors, moved, pushes = equations(pressed, workcell)
    if len(np.unique(pushes)) < 4:
        raise CalibrationRefused(
            f"only {len(np.unique(pushes))} pushes grew by {MIN_CHANGE_N:g} N or more from one "
            "depth to the next; push harder (--force)"
        )
    group = np.asarray(np.unique(pushes, return_inverse=True)[1], dtype=np.int64)
    before = np.asarray(workcell.joint_stiffness_nm_rad, float)
    fit, unit_m = _fitted(factors, moved, group, before)
    sd = np.minimum(fit.sd, PRIOR_SD)
    half = np.minimum(fit.half_width(), 1.96 * PRIOR_SD)
    found = before * np.exp(fit.shared)
    taken = tuple(bool(one < TAKEN_SD) for one in sd)
    kept = np.where(taken, found, before)
    squares, count = 0.0, 0
    for left_out in held_out_folds(fit.groups, folds):
        out = np.isin(group, left_out)
        _, rest = np.unique(group[~out], return_inverse=True)
        held_fit, _ = _fitted(factors[~out], moved[~out], np.asarray(rest, dtype=np.int64), before)
        off = factors[out] @ (np.exp(-held_fit.shared) / before) - moved[out]
        squares, count = squares + float(off @ off), count + len(off)
    push = factors[0] / moved[0]  # shares of the first push
    compliance = push * np.exp(-fit.shared) / before
    whole = float(np.sum(compliance))
    gradient = -compliance / whole
    tool_sd = float(np.sqrt(max(gradient @ fit.covariance @ gradient, 0.0)))
    levels = held(pressed.presses[0], workcell)
    normal = np.asarray(pressed.normal_base, float)
    pressed_n = abs(float((wrench_base(levels[1], workcell) - wrench_base(levels[0], workcell))[:3] @ normal))
    tool = pressed_n / float(factors[0] @ (np.exp(-fit.shared) / before))
    wide = float(fit.half_width()[0] / max(fit.sd[0], 1e-12))
    return StiffnessFit(
        found, sd, half, taken, tool, tool_sd * wide, fit.rms * unit_m, float(np.sqrt(squares / count)),
        float(np.sqrt(np.mean(moved**2))), fit, _missing(taken, half), _doubts(kept / before, fit.rms * unit_m, moved),
    )  # fmt: skip


def _missing(taken: tuple[bool, ...], half: Array) -> tuple[str, ...]:
    open_ones = [index for index, one in enumerate(taken) if not one]
    return tuple(
        f"joint {index + 1} stays as it was: its stiffness is known to {half[index]:.0%} only; push in postures in "
        f"which the force has a longer lever about its axis"
        for index in open_ones
    )


def _doubts(factor: Array, rms_m: float, moved: Array) -> tuple[str, ...]:
    said = [
        f"joint {index + 1} would be {value:.2g} times as stiff as the cell's file says"
        for index, value in enumerate(factor)
        if not PLAUSIBLE[0] < value < PLAUSIBLE[1]
    ]
    share = rms_m / max(float(np.sqrt(np.mean(moved**2))), 1e-12)
    if share > 0.1:
        said.append(
            f"{share:.0%} of the motion is not explained by joints that give way: play, a plate that moves, or a tip "
            "that slips; clamp the plate, or say cell.contact_stiffness_n_m"
        )
    return tuple(said)
