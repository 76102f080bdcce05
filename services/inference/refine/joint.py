"""The joint fit: taper, clearance, F/T origin and friction shared by all assemblies, and each assembly's own hole.

Robust nonlinear least squares over all touches and presses. Contacts are judged afresh in a few stages, in which the
whitening tightens from tenths of a millimetre to the true noise; within a stage they are fixed, and the fit is smooth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import adjoint_wrench
from services.inference.estimator import BoreWalls, EstimatorSettings, PressSettings
from services.inference.estimator.hypotheses import TouchBatch
from services.inference.refine.assemblies import AssemblyData
from services.inference.refine.camera import FeltHole
from services.inference.refine.parameters import (
    CLEARANCE,
    GEOMETRY,
    GEOMETRY_SD,
    LEAST_CLEARANCE_M,
    sensor_pose,
    shapes,
)
from services.inference.refine.pressed import PressModel
from services.inference.refine.touched import TouchModel, TouchState

# how well a hole is known where nothing touches it: about vision's worst
HOLE_SD = np.array([1e-3, 1e-3, 5e-3, 0.02, 0.02, 0.02])
SOFTNESS = (1.0, 0.4, 0.15, 0.05, 0.0, 0.0)
F_SCALE = 2.0
STEP = 1e-4  # of a parameter, in sds
EVALUATIONS = 12
FRICTION = len(GEOMETRY)
OWN = FRICTION + 1  # from here on the holes


@dataclass(frozen=True, slots=True, eq=False)
class JointFit:
    """parameters (8,) with covariance (8, 8); friction and its sd; the holes, with what presses and touches say of
    each; root mean square residual of touches and presses with the drawing's parameters and with the found ones, sds;
    and the share of touches that the fit explains, before and after."""

    parameters: Array
    covariance: Array
    friction: float
    friction_sd: float
    holes: tuple[FeltHole, ...]
    rms_before: float
    rms_after: float


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """All data as arrays; `owner_touch`, `owner_press`: which assembly each is of."""

    workcell: Workcell
    assemblies: Sequence[AssemblyData]
    prior_mean: Array
    prior_root: Array
    settings: EstimatorSettings
    press_settings: PressSettings

    def unpacked(self, x: Array) -> tuple[Array, float, list[Pose]]:
        """Parameters (8,), friction, and the holes."""
        moves = x[OWN:].reshape(-1, 6) * HOLE_SD
        holes = [
            one.pose_base_hole @ Pose.from_rotvec(move[3:], move[:3])
            for one, move in zip(self.assemblies, moves, strict=True)
        ]
        return x[:FRICTION] * GEOMETRY_SD, self.friction(x), holes

    def friction(self, x: Array) -> float:
        """The friction coefficient."""
        return float(np.clip(self.settings.friction_mean + x[FRICTION] * self.settings.friction_sd, 0.0, 0.8))

    def touch_state(self, parameters: Array, holes: Sequence[Pose]) -> TouchState:
        """All touches against their own holes."""
        to_peg = adjoint_wrench(sensor_pose(parameters))
        rotation, translation, wrenches, motion = [], [], [], []
        for one, hole in zip(self.assemblies, holes, strict=True):
            for touch in one.touches:
                wrench = to_peg @ touch.wrench_peg
                twist = touch.compliance_peg @ wrench
                pose = hole.inverse() @ touch.pose_base_peg @ Pose.from_rotvec(twist[3:], twist[:3])
                rotation.append(pose.rotation)
                translation.append(pose.translation_m)
                wrenches.append(wrench)
                motion.append(hole.rotation.T @ touch.motion_direction_base)
        return TouchState(np.array(rotation), np.array(translation), np.array(wrenches), np.array(motion))

    def press_states(self, parameters: Array, holes: Sequence[Pose]) -> list[tuple[Pose, Array]]:
        """Peg in hole and wrench of all presses."""
        to_peg = adjoint_wrench(sensor_pose(parameters))
        states = []
        for one, hole in zip(self.assemblies, holes, strict=True):
            for press in one.presses:
                wrench = to_peg @ press.wrench_peg
                twist = press.compliance_peg @ wrench
                states.append((hole.inverse() @ press.pose_base_peg @ Pose.from_rotvec(twist[3:], twist[:3]), wrench))
        return states

    def owners(self) -> tuple[Array, Array]:
        """The assembly of each touch and of each press."""
        touch = [index for index, one in enumerate(self.assemblies) for _ in one.touches]
        press = [index for index, one in enumerate(self.assemblies) for _ in one.presses]
        return np.array(touch, int), np.array(press, int)


@dataclass(frozen=True, slots=True, eq=False)
class _Stage:
    """The contacts as judged at one state: residuals and Jacobian around it."""

    problem: _Problem
    touches: TouchModel | None
    presses: list[PressModel]
    owner: Array  # of every row of data

    @classmethod
    def of(cls, problem: _Problem, x: Array, softness: float) -> _Stage:
        parameters, friction, holes = problem.unpacked(x)
        every = [touch for one in problem.assemblies for touch in one.touches]
        by_touch, by_press = problem.owners()
        touches, rows = None, []
        if every:
            batch = TouchBatch.of(every, problem.settings)
            touches = TouchModel.of(
                problem.workcell, problem.touch_state(parameters, holes), parameters, friction, batch.sd,
                batch.compliance, problem.settings, softness,
            )  # fmt: skip
            width = 6 + touches.pressing.shape[1] + touches.overlapping.shape[1]
            rows.append(np.repeat(by_touch, width))
        peg, hole = shapes(problem.workcell, 0.0, 0.0)
        walls = BoreWalls.of(peg, hole)
        presses = [
            PressModel.of(
                walls, hole.chamfer_m, peg.taper_start_m, pose, wrench, float(parameters[CLEARANCE]),
                problem.press_settings,
            )
            for pose, wrench in problem.press_states(parameters, holes)
        ]  # fmt: skip
        rows += [np.full(5 + len(model.points), owner) for model, owner in zip(presses, by_press, strict=True)]
        return cls(problem, touches, presses, np.concatenate(rows))

    def data(self, x: Array) -> Array:
        """Residuals of touches and presses."""
        parameters, friction, holes = self.problem.unpacked(x)
        parts = []
        if self.touches is not None:
            parts.append(
                self.touches.residual(self.problem.touch_state(parameters, holes), parameters, friction).ravel()
            )
        for model, (pose, wrench) in zip(self.presses, self.problem.press_states(parameters, holes), strict=True):
            parts.append(model.residual(pose, wrench, parameters))
        return np.concatenate(parts)

    def residual(self, x: Array) -> Array:
        """With what is known before."""
        known = self.problem.prior_root @ (x[:FRICTION] * GEOMETRY_SD - self.problem.prior_mean)
        return np.concatenate([self.data(x), known, x[FRICTION:]])

    def jacobian(self, x: Array) -> Array:
        """By differences; the holes of all assemblies are moved at once, for none sees another's."""
        here = self.data(x)
        count = len(here)
        matrix = np.zeros((count + len(x), len(x)))
        for column in range(OWN):
            moved = x.copy()
            moved[column] += STEP
            matrix[:count, column] = (self.data(moved) - here) / STEP
        for axis in range(6):
            moved = x.copy()
            moved[OWN + axis :: 6] += STEP
            matrix[np.arange(count), OWN + 6 * self.owner + axis] = (self.data(moved) - here) / STEP
        matrix[count : count + FRICTION, :FRICTION] = self.problem.prior_root * GEOMETRY_SD
        matrix[count + FRICTION :, FRICTION:] = np.eye(len(x) - FRICTION)
        return matrix


def joint_fit(
    workcell: Workcell,
    assemblies: Sequence[AssemblyData],
    before: Array,
    turn: tuple[Array, Array] | None = None,
    tell: Callable[[str, int, int], None] = lambda doing, done, total: None,
    settings: EstimatorSettings | None = None,
) -> JointFit:
    """Before (8,): the parameters in use; turn: the sensor's, with covariance, as weighing found it.

    The tolerances of `parameters` are the prior, about the drawing (and a sensor that sits straight).
    ValueError without assemblies.
    """
    if not assemblies:
        raise ValueError("joint_fit wants at least one assembly with presses")
    settings = settings or EstimatorSettings(friction_mean=workcell.friction_expected)
    mean, information = np.zeros(len(GEOMETRY)), np.diag(GEOMETRY_SD**-2.0)
    if turn is not None:
        # the tolerance is in it already
        information[5:, 5:] = np.linalg.inv(turn[1])
        mean[5:] = turn[0]
    problem = _Problem(
        workcell, assemblies, mean, np.linalg.cholesky(information).T, settings, PressSettings()
    )  # fmt: skip
    x = np.zeros(OWN + 6 * len(assemblies))
    fixed = x.copy()
    fixed[:FRICTION] = before / GEOMETRY_SD
    x[:FRICTION] = np.where(np.arange(FRICTION) >= 5, mean, before) / GEOMETRY_SD
    total = 2 * len(SOFTNESS)
    step = 0

    def told() -> None:
        nonlocal step
        step += 1
        tell("fitting", step, total)

    fixed, held = _fitted(problem, fixed, told, OWN - 1)
    # the holes as they come out with the old parameters are the better start
    x[FRICTION:] = fixed[FRICTION:]
    x, fit = _fitted(problem, x, told, 0)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * fit.birge
    parameters, friction, holes = problem.unpacked(x)
    return JointFit(
        parameters,
        covariance[:FRICTION, :FRICTION] * np.outer(GEOMETRY_SD, GEOMETRY_SD),
        friction,
        float(np.sqrt(covariance[FRICTION, FRICTION])) * settings.friction_sd,
        tuple(
            FeltHole(hole, _information(covariance[OWN + 6 * i : OWN + 6 * i + 6, OWN + 6 * i : OWN + 6 * i + 6]))
            for i, hole in enumerate(holes)
        ),
        held.rms,
        fit.rms,
    )


def _information(covariance: Array) -> Array:
    """Of a hole by touches and presses alone: what was known before, one sd of HOLE_SD, is taken out."""
    information = np.linalg.inv(covariance) - np.eye(6)
    values, vectors = np.linalg.eigh(information)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T / np.outer(HOLE_SD, HOLE_SD))


@dataclass(frozen=True, slots=True, eq=False)
class _Ended:
    """A fit's Jacobian, the ratio by which its residuals exceed their noise (1 or more), and their rms, sds."""

    jac: Array
    birge: float
    rms: float


def _fitted(problem: _Problem, x: Array, told: Callable[[], None], held: int) -> tuple[Array, _Ended]:
    """All stages from a start; the first `held` unknowns stay."""
    clearance = problem.workcell.hole.clearance_m
    lower = np.full(len(x), -np.inf)
    lower[CLEARANCE] = (LEAST_CLEARANCE_M - clearance) / GEOMETRY_SD[CLEARANCE]
    free = slice(held, None)
    ended: _Ended | None = None
    for softness in SOFTNESS:
        stage = _Stage.of(problem, x, softness)
        start = x.copy()

        def whole(part: Array, start: Array = start) -> Array:
            return np.concatenate([start[:held], part])

        fit = least_squares(
            lambda part, stage=stage, whole=whole: stage.residual(whole(part)),
            x[free],
            jac=lambda part, stage=stage, whole=whole: stage.jacobian(whole(part))[:, free],
            bounds=(lower[free], np.inf),
            loss="soft_l1", f_scale=F_SCALE, max_nfev=EVALUATIONS,
        )  # fmt: skip
        x = whole(fit.x)
        data = stage.data(x)
        counted = data[data != 0.0]
        # clipped like the robust loss, so that one wild touch does not stand for all
        freedom = max(len(counted) - len(x), 1)
        birge = max(1.0, float(np.sum(np.minimum(counted**2, 9.0))) / freedom)
        ended = _Ended(fit.jac, birge, float(np.sqrt(np.mean(np.minimum(counted**2, 100.0)))))
        told()
    assert ended is not None
    return x, ended


__all__ = ["HOLE_SD", "JointFit", "joint_fit"]
