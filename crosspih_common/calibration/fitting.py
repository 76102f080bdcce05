"""Least squares over groups of observations, with intervals that hold where the errors of one group belong together.

A pose of the arm, a picture or a push gives many numbers with one error in common (the arm stood a little elsewhere),
so the scatter of the single residuals says too little. The covariance here is the jackknife over groups in its linear
form, CR3 of Bell and McCaffrey (2002, Survey Methodology 28, 169): each group is left out in turn, and how far the
answer moves is how sure it is. It errs on the side of caution.

Unknowns are `shared` by all groups, or `own` of one group (the pose of the board in one picture); the own ones are
eliminated group by group (Schur complement), so that many pictures cost no more than their sum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from crosspih_common.errors import CrosspihError
from crosspih_common.geometry.pose import Array

Residual = Callable[[Array, Array], Array]
STEPS, DONE, WORST_DAMPING = 60, 1e-9, 1e8
LEAST_EIGENVALUE = 1e-14


class CalibrationRefused(CrosspihError):
    """The data do not fix what is asked, or cannot be; the text says what is missing and how to get it."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """shared (p,) and own (n, k); covariance (p, p) of the shared ones by groups; residual (m,), and groups n."""

    shared: Array
    own: Array
    covariance: Array
    residual: Array
    group: NDArray[np.int64]

    @property
    def groups(self) -> int:
        """How many groups there were."""
        return int(self.group.max()) + 1

    @property
    def rms(self) -> float:
        """Of the residuals, in their own unit."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def sd(self) -> Array:
        """(p,): one standard deviation of each shared unknown."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)), dtype=float)

    def half_width(self, share: float = 0.95) -> Array:
        """(p,): half of the interval that holds each shared unknown in that share of all calibrations (Student)."""
        return self.sd * float(student.ppf(0.5 + share / 2.0, max(self.groups - 1, 1)))

    def rms_of(self) -> Array:
        """(n,): of the residuals of each group."""
        squares = np.bincount(self.group, self.residual**2, self.groups)
        return np.asarray(np.sqrt(squares / np.maximum(np.bincount(self.group, minlength=self.groups), 1)))


def _jacobians(residual: Residual, shared: Array, own: Array, steps: Array, own_steps: Array) -> tuple[Array, Array]:
    """By shared unknowns (m, p), and by the own ones of each row's group (m, k): central differences."""
    by_shared = [
        (residual(shared + step, own) - residual(shared - step, own)) / (2.0 * size)
        for size, step in zip(steps, np.diag(steps), strict=True)
    ]
    by_own = [
        (residual(shared, own + step) - residual(shared, own - step)) / (2.0 * size)
        for size, step in zip(own_steps, np.diag(own_steps), strict=True)
    ]
    count = len(residual(shared, own)) if not by_shared and not by_own else len((by_shared or by_own)[0])
    return (
        np.stack(by_shared, axis=1) if by_shared else np.zeros((count, 0)),
        np.stack(by_own, axis=1) if by_own else np.zeros((count, 0)),
    )


def fit_groups(
    residual: Residual, shared: Array, own: Array, group: NDArray[np.int64], steps: Array, own_steps: Array,
    prior_sd: Array | None = None,
) -> Fit:  # fmt: skip
    """Levenberg and Marquardt from a start.

    `residual(shared (p,), own (n, k))` is (m,), each row of the group (m,) it belongs to and independent of the own
    unknowns of other groups. `steps` (p,) and `own_steps` (k,) are small changes of the unknowns, by which it is
    differenced. `prior_sd` (p,) holds shared unknowns near their start, where it is finite. Raises CalibrationRefused
    when the data leave a combination of unknowns wholly open.
    """
    shared, own = np.array(shared, float), np.array(own, float)
    start = shared.copy()
    weight = np.zeros(len(shared)) if prior_sd is None else np.where(np.isfinite(prior_sd), prior_sd, np.inf) ** -2.0
    groups = int(group.max()) + 1
    rows = [np.flatnonzero(group == index) for index in range(groups)]
    damping = 1e-3
    now = residual(shared, own)
    cost = float(now @ now) + float(weight @ (shared - start) ** 2)
    for _ in range(STEPS):
        by_shared, by_own = _jacobians(residual, shared, own, steps, own_steps)
        while True:
            step, own_step = _step(now, by_shared, by_own, rows, damping, weight, shared - start)
            tried = residual(shared + step, own + own_step)
            tried_cost = float(tried @ tried) + float(weight @ (shared + step - start) ** 2)
            if np.isfinite(tried_cost) and tried_cost <= cost:
                break
            damping *= 10.0
            if damping > WORST_DAMPING:
                return _finished(now, shared, own, group, rows, by_shared, by_own, weight)
        gained = cost - tried_cost
        shared, own, now, cost = shared + step, own + own_step, tried, tried_cost
        damping = max(damping / 10.0, 1e-12)
        if gained <= DONE * max(cost, 1e-300):
            break
    by_shared, by_own = _jacobians(residual, shared, own, steps, own_steps)
    return _finished(now, shared, own, group, rows, by_shared, by_own, weight)


def _step(
    now: Array, by_shared: Array, by_own: Array, rows: list[NDArray[np.int64]], damping: float, weight: Array,
    off: Array,
) -> tuple[Array, Array]:  # fmt: skip
    width, own_width = by_shared.shape[1], by_own.shape[1]
    scale = np.einsum("ij,ij->j", by_shared, by_shared) + weight
    normal = np.diag(weight + damping * np.maximum(scale, 1e-30))
    pull = -weight * off
    kept = []
    for row in rows:
        shared_block, own_block, part = by_shared[row], by_own[row], now[row]
        normal += shared_block.T @ shared_block
        pull -= shared_block.T @ part
        if own_width:
            own_normal = own_block.T @ own_block
            own_normal += np.diag(damping * np.maximum(np.diag(own_normal), 1e-30))
            cross = shared_block.T @ own_block
            solved = np.linalg.solve(own_normal, np.column_stack([cross.T, -own_block.T @ part]))
            normal -= cross @ solved[:, :width]
            pull -= cross @ solved[:, width]
            kept.append(solved)
    step = np.linalg.lstsq(normal, pull, rcond=None)[0] if width else np.zeros(0)
    own_step = np.array([solved[:, width] - solved[:, :width] @ step for solved in kept])
    return np.asarray(step, float), np.asarray(own_step, float) if own_width else np.zeros((len(rows), 0))


def _finished(
    now: Array, shared: Array, own: Array, group: NDArray[np.int64], rows: list[NDArray[np.int64]], by_shared: Array,
    by_own: Array, weight: Array,
) -> Fit:  # fmt: skip
    reduced, pulls = [], []
    for row in rows:
        block, part = by_shared[row], now[row]
        if by_own.shape[1]:
            basis, _ = np.linalg.qr(by_own[row])
            block = block - basis @ (basis.T @ block)
            part = part - basis @ (basis.T @ part)
        reduced.append(block.T @ block)
        pulls.append(block.T @ part)
    width = len(shared)
    if not width:
        return Fit(shared, own, np.zeros((0, 0)), now, group)
    whole = np.sum(reduced, axis=0) + np.diag(weight)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(whole), 1e-300))
    if float(np.linalg.eigvalsh(whole * np.outer(scale, scale))[0]) < LEAST_EIGENVALUE:
        raise CalibrationRefused("the data leave a combination of the unknowns open: take more that differ")
    covariance = np.zeros((width, width))
    for block, pull in zip(reduced, pulls, strict=True):
        left = (whole - block) * np.outer(scale, scale)
        left += np.diag(np.full(width, LEAST_EIGENVALUE))
        moved = scale * np.linalg.solve(left, scale * pull)
        covariance += np.outer(moved, moved)
    count = len(rows)
    covariance *= (count - 1.0) / count
    if np.any(weight > 0.0):
        # what is held by the prior is no surer than the prior lets it be, and no less sure than the data with it
        inverse = np.linalg.inv(whole)
        covariance += inverse @ np.diag(weight) @ inverse
    return Fit(shared, own, covariance, now, group)


def held_out_folds(groups: int, folds: int = 5) -> list[NDArray[np.int64]]:
    """Groups to leave out together, every so-manieth: at least two groups stay in."""
    folds = max(2, min(folds, groups))
    return [np.arange(first, groups, folds) for first in range(folds)]
