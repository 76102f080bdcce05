"""The TCP: the position of the peg on the flange, by touches of one plane with different corners and tilts.

A touch at zero force puts the corner v of the tip on the plane: n . (R (v + s) + t) = d, with R and t of the peg frame
from the encoders and s the peg's offset from the cell's file. The plane (n, d) is unknown as well. Tilts to different
sides determine s across the peg's axis; tilts of different size determine it along the axis, less precisely. With two
depths of a push the pose at zero force follows by linear extrapolation, for any stiffness of the arm. Friction does not
grow in proportion to the force, so the bending by the cell file's stiffness is subtracted before that.

A real edge is rounded. With radius r it lets the peg come nearer by r (m.n - 1), m the vector from the centre of the
rounding to the corner over r; this grows with the tilt. Along the peg the tip moves by some three times r, equally in
all touches, so more touches do not reduce it. The interval includes this error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from crosspih_common.calibration.fitting import CalibrationRefused, GroupedFit, Residual, fit_groups, held_out_folds
from crosspih_common.calibration.presses import (
    APART_M,
    Pressed,
    held,
    jacobian_at,
    require,
    touching_corner,
    wrench_base,
)
from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

MIN_TILT_SPREAD = 0.1
UNIT_M = 1e-6
FLOOR_M = 5e-7  # least standard deviation of a touch: neither edges nor encoders are better
EDGE_M = 5e-6  # standard deviation of the rounding radius of a nominally sharp edge
FAR_M = 0.01
STEPS = np.array([1e-6] * 3 + [1e-5] * 2 + [1e-6])


@dataclass(frozen=True, slots=True, eq=False)
class TipFit:
    """shift_m (3,): the peg's offset from the cell's file, in the peg frame; tip_flange_m (3,): the tip's centre in the
    flange frame; sd and half of the 95 % interval (3,); residual and held-out error of the touches, m."""

    shift_m: Array
    tip_flange_m: Array
    sd_m: Array
    half_m: Array
    rms_m: float
    held_out_m: float
    touches: int
    fit: GroupedFit
    missing: tuple[str, ...]
    doubts: tuple[str, ...]


def touches_at_no_force(pressed: Pressed, workcell: Workcell) -> tuple[Array, Array, Array]:
    """Rotations (k, 3, 3) and places (k, 3), m, of the peg frame in the base, and corners (k, 3) of the peg."""
    normal, peg = np.asarray(pressed.normal_base, float), workcell.peg.shape()
    rotations, places, corners = [], [], []
    for press in pressed.presses:
        levels = held(press, workcell)
        first, last = levels[0], levels[-1]
        corner, apart = touching_corner(peg, first.pose_base_peg.rotation, normal)
        wrenches = [wrench_base(level, workcell) for level in (first, last)]
        force = [-float(wrench[:3] @ normal) for wrench in wrenches]
        if apart < APART_M or force[1] - force[0] < 1.0:
            continue
        share = force[0] / (force[1] - force[0])
        ends = [
            level.pose_base_peg.translation_m + _bent(workcell, level.joints_rad, corner, wrench)
            for level, wrench in zip((first, last), wrenches, strict=True)
        ]
        rotations.append(first.pose_base_peg.rotation)
        places.append(ends[0] - share * (ends[1] - ends[0]))
        corners.append(corner)
    return np.array(rotations).reshape(-1, 3, 3), np.array(places).reshape(-1, 3), np.array(corners).reshape(-1, 3)


def _bent(workcell: Workcell, joints_rad: Array, corner: Array, wrench: Array) -> Array:
    """(3,): the displacement, m, of the corner (3,) by a wrench (6,) on the peg, base axes about the peg's origin."""
    torque = workcell.arm().jacobian(joints_rad, workcell.pose_flange_peg()).T @ wrench
    give = torque / np.asarray(workcell.joint_stiffness_nm_rad)
    return np.asarray(jacobian_at(workcell, joints_rad, corner) @ give, dtype=float)


def fit_tip(pressed: Pressed, workcell: Workcell, folds: int = 5) -> TipFit:
    """Fit the TCP. Raises CalibrationRefused that names the missing tilts."""
    require(pressed, 7)
    rotations, places, corners = touches_at_no_force(pressed, workcell)
    normal = np.asarray(pressed.normal_base, float)
    if len(rotations) < 7:
        raise CalibrationRefused(
            f"{len(rotations)} touches are by one corner of the tip, want 7 or more: tilt the peg towards its corners"
        )
    leaning = np.einsum("kji,j->ki", rotations, normal)
    if np.linalg.svd(leaning[:, :2] - leaning[:, :2].mean(axis=0), compute_uv=False)[1] < MIN_TILT_SPREAD:
        raise CalibrationRefused(
            "the peg was tilted to one side only: across it the tip stays open; tilt to at least three sides"
        )
    if float(np.ptp(leaning[:, 2])) < 0.02:
        raise CalibrationRefused(
            "all tilts are of the same size: along the peg's axis the tip stays open; touch nearly upright as well"
        )
    across = np.linalg.svd(normal[None])[2][1:]
    start = np.concatenate(
        [np.zeros(5), [float(np.mean((np.einsum("kij,kj->ki", rotations, corners) + places) @ normal))]]
    )

    def residual_of(chosen: NDArray[np.int64]) -> Residual:
        def residual(shared: Array, _: Array) -> Array:
            way = normal + shared[3:5] @ across
            way = way / np.linalg.norm(way)
            at = np.einsum("kij,kj->ki", rotations[chosen], corners[chosen] + shared[:3]) + places[chosen]
            return np.asarray((at @ way - shared[5]) / UNIT_M)

        return residual

    def fitted(chosen: NDArray[np.int64]) -> GroupedFit:
        own, group = np.zeros((len(chosen), 0)), np.arange(len(chosen))
        return fit_groups(residual_of(chosen), start, own, group, STEPS, np.zeros(0))

    everything = np.arange(len(rotations), dtype=np.int64)
    fit = fitted(everything)
    touched = np.einsum("kij,kj->ki", rotations, corners + fit.shared[:3]) + places
    design = np.column_stack([leaning, touched @ across.T, -np.ones(len(rotations))])
    back = np.linalg.inv(design.T @ design)
    tilted = np.linalg.norm(leaning[:, :2], axis=1)
    by_edge = EDGE_M * back @ (design.T @ (np.sqrt(2.0) * tilted + leaning[:, 2] - 1.0))  # of a right-angled corner
    fit = replace(fit, covariance=fit.covariance + FLOOR_M**2 * back + np.outer(by_edge, by_edge))
    squares = 0.0
    for left_out in held_out_folds(len(rotations), folds):
        held_fit = fitted(np.setdiff1d(everything, left_out))
        off = residual_of(left_out)(held_fit.shared, np.zeros(0))
        squares += float(off @ off)
    shift, half = fit.shared[:3], fit.half_width()[:3]
    tip = workcell.pose_flange_peg() @ Pose.from_translation(shift)
    missing, doubts = [], []
    if float(half.max()) > 1e-4:
        axis = int(np.argmax(half))
        how = "touch nearly upright and tilted by 25 degrees" if axis == 2 else "touch with tilts to more sides"
        missing.append(f"along {'xyz'[axis]} of the peg the tip is known to {half[axis] * 1e3:.2f} mm; {how}")
    if float(np.linalg.norm(shift)) > FAR_M:
        doubts.append(
            f"the peg would sit {np.linalg.norm(shift) * 1e3:.1f} mm from where cell.flange_to_ft has it: another peg?"
        )
    return TipFit(
        shift, tip.apply([0.0, 0.0, workcell.peg.shape().tip_m]), fit.sd[:3], half, fit.rms * UNIT_M,
        float(np.sqrt(squares / len(rotations))) * UNIT_M, len(rotations), fit, tuple(missing), tuple(doubts),
    )  # fmt: skip
