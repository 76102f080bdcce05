"""The joint fit: taper, clearance, F/T sensor, camera and friction, common to all assemblies, and the hole of each.

Robust nonlinear least squares over the poses found by vision, all touches and all presses. Contacts are chosen anew in
a few stages, in which the whitening tightens from tenths of a millimetre to the true noise. Within a stage they are
fixed, and the fit is smooth.
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
from services.inference.cell_refinement.assemblies import AssemblyData
from services.inference.cell_refinement.parameters import (
    CLEARANCE,
    MIN_CLEARANCE_M,
    NAMES,
    PRIOR_SD,
    TURN,
    camera_pose,
    sensor_pose,
    shapes,
)
from services.inference.cell_refinement.pressed import PressModel
from services.inference.cell_refinement.touched import TouchModel, TouchState
from services.inference.estimator import BoreWalls, EstimatorSettings
from services.inference.estimator.hypotheses import TouchBatch

# prior sd of a hole about T2, before any data: far wider than its error
HOLE_SD = np.array([3e-3, 3e-3, 3e-2, 0.05, 0.05, 0.05])
SOFTNESS = (1.0, 0.4, 0.15, 0.05, 0.0, 0.0)
F_SCALE = 2.0
STEP = 1e-4  # step of a parameter, in sds
EVALUATIONS = 12
FRICTION = len(NAMES)
OWN = FRICTION + 1  # first index of the holes


@dataclass(frozen=True, slots=True, eq=False)
class JointFit:
    """parameters (14,) with covariance (14, 14); friction and its sd; the holes; rms residuals, in sds, of contacts and
    of vision, with the parameters that were in use and with those found."""

    parameters: Array
    covariance: Array
    friction: float
    friction_sd: float
    holes: tuple[Pose, ...]
    contact_rms: tuple[float, float]
    vision_rms: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """The data to fit, and the prior of the parameters: a mean and the root of the information."""

    workcell: Workcell
    assemblies: Sequence[AssemblyData]
    prior_mean: Array
    prior_root: Array
    settings: EstimatorSettings

    def unpacked(self, x: Array) -> tuple[Array, float, list[Pose]]:
        """Parameters (14,), friction, and the holes."""
        moves = x[OWN:].reshape(-1, 6) * HOLE_SD
        holes = [
            one.pose_base_hole @ Pose.from_rotvec(move[3:], move[:3])
            for one, move in zip(self.assemblies, moves, strict=True)
        ]
        return x[:FRICTION] * PRIOR_SD, self.friction(x), holes

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

    def vision(self, parameters: Array, holes: Sequence[Pose]) -> Array:
        """(6 V,): residuals of the holes seen by vision against the fitted holes, in sds."""
        correction = camera_pose(parameters)
        parts = [np.zeros(0)]
        for one, hole in zip(self.assemblies, holes, strict=True):
            if one.seen is not None:
                pose = one.seen.pose_base_camera @ correction @ one.seen.pose_camera_hole
                between = pose.inverse() @ hole
                error = np.concatenate([between.translation_m, between.rotvec_rad()])
                parts.append(np.linalg.solve(np.linalg.cholesky(one.seen.covariance), error))
        return np.concatenate(parts)

    def owners(self) -> tuple[Array, Array]:
        """The assembly of each touch and of each press."""
        touch = [index for index, one in enumerate(self.assemblies) for _ in one.touches]
        press = [index for index, one in enumerate(self.assemblies) for _ in one.presses]
        return np.array(touch, int), np.array(press, int)


@dataclass(frozen=True, slots=True, eq=False)
class _Stage:
    """The contacts chosen at one state: residuals and Jacobian around it."""

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
                walls, hole.chamfer_m, peg.taper_start_m, pose, wrench, float(parameters[CLEARANCE])
            )
            for pose, wrench in problem.press_states(parameters, holes)
        ]  # fmt: skip
        rows += [np.full(len(model.points), owner) for model, owner in zip(presses, by_press, strict=True)]
        rows += [np.full(6, index) for index, one in enumerate(problem.assemblies) if one.seen is not None]
        return cls(problem, touches, presses, np.concatenate(rows))

    def data(self, x: Array) -> Array:
        """Residuals of touches, of presses, and last of vision."""
        parameters, friction, holes = self.problem.unpacked(x)
        parts = []
        if self.touches is not None:
            parts.append(
                self.touches.residual(self.problem.touch_state(parameters, holes), parameters, friction).ravel()
            )
        for model, (pose, _) in zip(self.presses, self.problem.press_states(parameters, holes), strict=True):
            parts.append(model.residual(pose, parameters))
        return np.concatenate([*parts, self.problem.vision(parameters, holes)])

    def residual(self, x: Array) -> Array:
        """The residuals of data and prior."""
        known = self.problem.prior_root @ (x[:FRICTION] * PRIOR_SD - self.problem.prior_mean)
        return np.concatenate([self.data(x), known, x[FRICTION:]])

    def jacobian(self, x: Array) -> Array:
        """By differences; the holes of all assemblies are moved at once, because their data are independent."""
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
        matrix[count : count + FRICTION, :FRICTION] = self.problem.prior_root * PRIOR_SD
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
    """`before` (14,): the parameters in use; `turn`: the sensor's rotation and its covariance, from its weighings.

    The prior is given by the tolerances of `parameters`, about the drawing, an aligned sensor and the camera as
    calibrated. Raises ValueError without assemblies.
    """
    if not assemblies:
        raise ValueError("joint_fit wants at least one assembly with presses")
    settings = settings or EstimatorSettings(friction_mean=workcell.friction_expected)
    mean, information = np.zeros(len(NAMES)), np.diag(PRIOR_SD**-2.0)
    if turn is not None:
        # the covariance already includes the tolerance
        mean[TURN], information[TURN, TURN] = turn[0], np.linalg.inv(turn[1])
    root = np.asarray(np.linalg.cholesky(information).T, dtype=np.float64)
    problem = _Problem(workcell, assemblies, mean, root, settings)
    # presses need no softness: their forces show which walls they meet
    stages = SOFTNESS if any(one.touches for one in assemblies) else SOFTNESS[-2:]
    steps = iter(range(1, 2 * len(stages) + 1))

    def told() -> None:
        tell("fitting", next(steps), 2 * len(stages))

    start = np.zeros(OWN + 6 * len(assemblies))
    start[:FRICTION] = before / PRIOR_SD
    held = _fitted(problem, start, stages, told, FRICTION)
    # the holes fitted with the old parameters are the better start
    start = held.x.copy()
    if turn is not None:
        start[TURN] = mean[TURN] / PRIOR_SD[TURN]
    fit = _fitted(problem, start, stages, told, 0)
    parameters, friction, holes = problem.unpacked(fit.x)
    covariance = np.asarray(np.linalg.inv(fit.jacobian.T @ fit.jacobian) * fit.birge, dtype=np.float64)
    return JointFit(
        parameters,
        covariance[:FRICTION, :FRICTION] * np.outer(PRIOR_SD, PRIOR_SD),
        friction,
        float(np.sqrt(covariance[FRICTION, FRICTION])) * settings.friction_sd,
        tuple(holes),
        (held.contact_rms, fit.contact_rms),
        (held.vision_rms, fit.vision_rms),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Ended:
    """The end of a fit: the unknowns, the robust Jacobian, the ratio of residuals to their noise (1 or more), and their
    rms."""

    x: Array
    jacobian: Array
    birge: float
    contact_rms: float
    vision_rms: float


def _rms(residuals: Array) -> float:
    """The rms of clipped residuals, so that one outlier does not dominate; inactive rows (no overlap) are left out."""
    asked = residuals[residuals != 0.0]
    return float(np.sqrt(np.mean(np.minimum(asked**2, 100.0)))) if len(asked) else 0.0


def _fitted(problem: _Problem, x: Array, stages: Sequence[float], told: Callable[[], None], held: int) -> _Ended:
    """Run all stages from a start; the first `held` unknowns stay fixed."""
    lower = np.full(len(x), -np.inf)
    lower[CLEARANCE] = (MIN_CLEARANCE_M - problem.workcell.hole.clearance_m) / PRIOR_SD[CLEARANCE]
    jacobian = np.zeros((0, 0))
    stage = _Stage.of(problem, x, stages[0])
    for softness in stages:
        stage = _Stage.of(problem, x, softness)
        x, jacobian = _descended(stage, x, lower, held)
        told()
    data = stage.data(x)
    seen = len(problem.vision(problem.unpacked(x)[0], problem.unpacked(x)[2]))
    contacts, vision = data[: len(data) - seen], data[len(data) - seen :]
    asked = data[data != 0.0]
    birge = max(1.0, float(np.sum(np.minimum(asked**2, 9.0))) / max(len(asked) - len(x), 1))
    return _Ended(x, jacobian, birge, _rms(contacts), _rms(vision))


def _descended(stage: _Stage, x: Array, lower: Array, held: int) -> tuple[Array, Array]:
    """Least squares with the stage's contacts: returns the unknowns and the robust Jacobian of the free ones."""
    fixed = x[:held]

    def residual(part: Array) -> Array:
        return stage.residual(np.concatenate([fixed, part]))

    def jacobian(part: Array) -> Array:
        return stage.jacobian(np.concatenate([fixed, part]))[:, held:]

    fit = least_squares(
        residual, x[held:], jac=jacobian, bounds=(lower[held:], np.inf), loss="soft_l1", f_scale=F_SCALE,
        max_nfev=EVALUATIONS, x_scale="jac",
    )  # fmt: skip
    return np.concatenate([fixed, fit.x]), np.asarray(fit.jac, dtype=np.float64)
