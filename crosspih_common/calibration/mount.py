"""The mounting of the force/torque sensor: its rotation from gravity, its position from pushes on known corners.

- Gravity: at rest the sensor reads f = b + R_s^T R^T w, R the peg's orientation, w the weight in the base, b the bias.
  Orientations with different directions of gravity determine the rotation R_s for any w and b. They do not determine
  the position, because the unknown centroid of the tool shifts with it.
- Pushes: a contact at a point v of the peg changes the reading by dF and dM = R_s^T (v - p) x dF, about the sensor's
  position p. This determines p across the force but not along it, so the force must have several directions in the peg.

The position of the touching corner comes from the drawing. If the peg is mounted with an offset on its flange, the
answer is off by the same amount (run `crosspih calibrate tcp` first).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.calibration.fitting import CalibrationRefused, GroupedFit, fit_groups, held_out_folds
from crosspih_common.calibration.presses import APART_M, Pressed, held, require, touching_corner
from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

MIN_WEIGHINGS, MIN_SPREAD, MIN_OUT_OF_PLANE = 5, 0.25, 0.06
MIN_FORCE_N, MIN_CROSS = 2.0, 0.12
FLOOR_N, FLOOR_NM = 0.003, 2e-4
FAR_M, FAR_RAD = 0.01, np.deg2rad(5.0)


@dataclass(frozen=True, slots=True, eq=False)
class MountFit:
    """The pose_peg_sensor that was found. turn_rad (3,) of the sensor's axes and shift_m (3,) of its origin, in the peg
    frame, are relative to the cell's file, with half of the 95 % intervals; residuals and held-out errors, N and Nm."""

    pose_peg_sensor: Pose
    turn_rad: Array
    shift_m: Array
    turn_sd_rad: Array
    shift_sd_m: Array
    turn_half_rad: Array
    shift_half_m: Array
    weight_n: float
    rms_n: float
    rms_nm: float
    held_out_n: float
    held_out_nm: float
    fit: GroupedFit
    missing: tuple[str, ...]
    doubts: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Data:
    """Gravity: rotations (g, 3, 3) of the peg, forces (g, 3) and sd; pushes: corners (p, 3), dF and dM (p, 3), sd."""

    rotations: Array
    forces: Array
    forces_sd: Array
    corners: Array
    pushed: Array
    moments: Array
    moments_sd: Array
    group: NDArray[np.int64]  # first those of the gravity readings, then those of the pushes

    def without(self, out: NDArray[np.int64]) -> _Data:
        """The data without some groups; the others are renumbered."""
        gravity = ~np.isin(self.group[: len(self.forces)], out)
        pushes = ~np.isin(self.group[len(self.forces) :], out)
        _, group = np.unique(
            np.concatenate([self.group[: len(self.forces)][gravity], self.group[len(self.forces) :][pushes]]),
            return_inverse=True,
        )
        return _Data(
            self.rotations[gravity], self.forces[gravity], self.forces_sd[gravity], self.corners[pushes],
            self.pushed[pushes], self.moments[pushes], self.moments_sd[pushes], group,
        )  # fmt: skip


def _data(pressed: Pressed, workcell: Workcell) -> _Data:
    mounting, peg = workcell.sensor_mounting(), workcell.peg.shape()
    normal = np.asarray(pressed.normal_base, float)
    rotations, forces, forces_sd, group = [], [], [], []
    for index, level in enumerate((*pressed.weighings, *(press.free for press in pressed.presses))):
        rotations.append(workcell.pose_base_peg(level.joints_rad).rotation)
        forces.append(mounting.sensor(level.raw)[:3])
        forces_sd.append(np.hypot(mounting.sensor_sd(level.raw_sd)[:3], FLOOR_N))
        group.append(index)
    corners, pushed, moments, moments_sd, of_push = [], [], [], [], []
    for index, press in enumerate(pressed.presses):
        for pushing in held(press, workcell):
            wrench, sd = mounting.sensor(pushing.raw), mounting.sensor_sd(pushing.raw_sd)
            corner, apart = touching_corner(peg, pushing.pose_base_peg.rotation, normal)
            if np.linalg.norm(wrench[:3]) < MIN_FORCE_N or apart < APART_M:
                continue
            corners.append(corner)
            pushed.append(wrench[:3])
            moments.append(wrench[3:])
            lever = float(np.linalg.norm(corner))
            moments_sd.append(np.sqrt(sd[3:] ** 2 + (lever * sd[:3].max()) ** 2 + FLOOR_NM**2))
            of_push.append(len(pressed.weighings) + index)
    return _Data(
        np.array(rotations), np.array(forces), np.array(forces_sd), np.array(corners).reshape(-1, 3),
        np.array(pushed).reshape(-1, 3), np.array(moments).reshape(-1, 3), np.array(moments_sd).reshape(-1, 3),
        np.array([*group, *of_push], dtype=np.int64),
    )  # fmt: skip


def _expected(shared: Array, data: _Data, before: Pose) -> tuple[Array, Array]:
    """Forces (g, 3) of gravity and moments (p, 3) of pushes; the unknowns are the turn and the shift, the weight in the
    base and the bias."""
    turned = before @ Pose.from_rotvec(shared[:3], np.zeros(3))
    place = before.translation_m + shared[3:6]
    forces = np.einsum("gji,j->gi", data.rotations, shared[6:9]) @ turned.rotation + shared[9:12]
    levers = (data.corners - place) @ turned.rotation
    return forces, np.cross(levers, data.pushed)


def _fitted(data: _Data, before: Pose, start: Array) -> GroupedFit:
    def residual(shared: Array, _: Array) -> Array:
        forces, moments = _expected(shared, data, before)
        return np.concatenate([
            ((data.forces - forces) / data.forces_sd).ravel(), ((data.moments - moments) / data.moments_sd).ravel()
        ])  # fmt: skip

    steps = np.array([1e-5] * 3 + [1e-6] * 3 + [1e-4] * 6)
    group = np.asarray(np.repeat(data.group, 3), dtype=np.int64)
    return fit_groups(residual, start, np.zeros((int(group.max()) + 1, 0)), group, steps, np.zeros(0))


def fit_mount(pressed: Pressed, workcell: Workcell, folds: int = 5) -> MountFit:
    """Fit the mounting. Raises CalibrationRefused that names the missing orientations or pushes."""
    require(pressed)
    data, before = _data(pressed, workcell), workcell.sensor_mounting().pose_peg_sensor
    gravity = np.asarray(workcell.gravity_base_m_s2, float)
    down = gravity / np.linalg.norm(gravity)
    directions = down @ data.rotations
    spread = np.linalg.svd(directions - directions.mean(axis=0), compute_uv=False) / np.sqrt(len(directions))
    if len(directions) < MIN_WEIGHINGS or spread[1] < MIN_SPREAD or spread[2] < MIN_OUT_OF_PLANE:
        raise CalibrationRefused(
            f"in the {len(directions)} orientations gravity has nearly one direction, or turns in one plane only "
            f"({spread[1]:.2f} and {spread[2]:.2f} across it, want {MIN_SPREAD:g} and {MIN_OUT_OF_PLANE:g}): the "
            "sensor's turn stays open; turn the wrist further, about two axes"
        )
    if len(data.pushed) < 4:
        raise CalibrationRefused(
            f"{len(data.pushed)} pushes press with {MIN_FORCE_N:g} N on one corner of the tip; tilt the peg so that "
            "one corner touches, and push harder"
        )
    ways = data.pushed / np.linalg.norm(data.pushed, axis=1)[:, None]
    across = np.linalg.eigvalsh(np.eye(3) - ways.T @ ways / len(ways))[0]
    if across < MIN_CROSS**2 / 2.0:
        raise CalibrationRefused(
            "all pushes go along one direction of the peg: where the sensor is along it stays open; tilt the peg by 15 "
            "to 25 degrees to different sides"
        )
    design = np.concatenate(
        [np.swapaxes(data.rotations @ before.rotation, 1, 2), np.broadcast_to(np.eye(3), (len(data.forces), 3, 3))], 2
    )
    first = np.linalg.lstsq(design.reshape(-1, 6), data.forces.ravel(), rcond=None)[0]
    start = np.concatenate([np.zeros(6), first])
    fit = _fitted(data, before, start)
    forces, moments = _expected(fit.shared, data, before)
    weight = fit.shared[6:9]
    if float(weight @ down) < 0.0:
        raise CalibrationRefused(
            "the weight points up: the sensor tells the reaction; say the other cell.force_torque.reports "
            "(`crosspih cell check` shows it)"
        )
    out_n, out_nm = _held_out(data, before, fit, folds)
    pose = Pose(
        (before @ Pose.from_rotvec(fit.shared[:3], np.zeros(3))).rotation, before.translation_m + fit.shared[3:6]
    )
    sd, half = fit.sd, fit.half_width()
    missing = []
    if float(half[3:6].max()) > 1e-4:
        axis = "xyz"[int(np.argmax(half[3:6]))]
        missing.append(
            f"along {axis} of the peg the place is known to {half[3:6].max() * 1e3:.2f} mm; push harder across it"
        )
    if float(half[:3].max()) > np.deg2rad(0.1):
        axis = "xyz"[int(np.argmax(half[:3]))]
        missing.append(
            f"the turn about {axis} is known to {np.rad2deg(half[:3].max()):.2f} degrees; weigh in more orientations"
        )
    doubts = []
    if float(np.linalg.norm(fit.shared[3:6])) > FAR_M or float(np.linalg.norm(fit.shared[:3])) > FAR_RAD:
        doubts.append(
            f"the sensor would sit {np.linalg.norm(fit.shared[3:6]) * 1e3:.1f} mm and "
            f"{np.rad2deg(np.linalg.norm(fit.shared[:3])):.1f} degrees from where the cell's file has it; see "
            "cell.force_torque.pose_flange_sensor and the drawing of the peg"
        )
    return MountFit(
        pose, fit.shared[:3], fit.shared[3:6], sd[:3], sd[3:6], half[:3], half[3:6], float(np.linalg.norm(weight)),
        _rms(data.forces - forces), _rms(data.moments - moments),
        out_n, out_nm, fit, tuple(missing), tuple(doubts),
    )  # fmt: skip


def _held_out(data: _Data, before: Pose, fit: GroupedFit, folds: int) -> tuple[float, float]:
    off_n, off_nm = [], []
    count = len(data.forces)
    for left_out in held_out_folds(fit.groups, folds):
        held_fit = _fitted(data.without(left_out), before, fit.shared)
        forces, moments = _expected(held_fit.shared, data, before)
        off_n.append((data.forces - forces)[np.isin(data.group[:count], left_out)].ravel())
        off_nm.append((data.moments - moments)[np.isin(data.group[count:], left_out)].ravel())
    return _rms(np.concatenate(off_n)), _rms(np.concatenate(off_nm))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
