"""Least squares over groups of observations, with intervals that stay valid when the errors within a group correlate.

A pose of the arm, a picture or a push gives many numbers with one common error (for example of the arm's position), so
the scatter of single residuals understates the uncertainty. The covariance here is the jackknife over groups in its
linear form, CR3 of Bell and McCaffrey (2002, Survey Methodology 28, 169): each group is left out in turn, and the
covariance follows from how far the answer moves. It is a conservative estimate.

Unknowns are `shared` by all groups, or `own` of one group (the pose of the board in one picture); for the covariance
the own ones are projected out, group by group.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import stdtrit

from crosspih_common.errors import CrosspihError
from crosspih_common.geometry.pose import Array

Residual = Callable[[Array, Array], Array]
EVALUATIONS, DONE = 80, 1e-10
MIN_EIGENVALUE = 1e-14


class CalibrationRefused(CrosspihError):
    """The data do not determine the unknowns, or are impossible; the text says what is missing and how to get it."""


@dataclass(frozen=True, slots=True, eq=False)
class GroupedFit:
    """shared (p,) and own (n, k); covariance (p, p) of the shared ones by groups; residual (m,), and groups n."""

    shared: Array
    own: Array
    covariance: Array
    residual: Array
    group: NDArray[np.int64]

    @property
    def groups(self) -> int:
        """The number of groups."""
        return int(self.group.max()) + 1

    @property
    def rms(self) -> float:
        """The root mean square of the residuals, in their own unit."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def sd(self) -> Array:
        """(p,): one standard deviation of each shared unknown."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)), dtype=float)

    def half_width(self, share: float = 0.95) -> Array:
        """(p,): half of the confidence interval of each shared unknown at the level `share` (Student's t)."""
        return self.sd * float(stdtrit(max(self.groups - 1, 1), 0.5 + share / 2.0))

    def rms_of(self) -> Array:
        """(n,): the root mean square of each group's residuals."""
        squares = np.bincount(self.group, self.residual**2, self.groups)
        return np.asarray(np.sqrt(squares / np.maximum(np.bincount(self.group, minlength=self.groups), 1)))


def _jacobians(residual: Residual, shared: Array, own: Array, steps: Array, own_steps: Array) -> tuple[Array, Array]:
    """Central differences by the shared unknowns (m, p), and by the own unknowns of each row's group (m, k)."""
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
) -> GroupedFit:  # fmt: skip
    """SciPy's trust-region least squares from a start, then the covariance by groups.

    `residual(shared (p,), own (n, k))` is (m,). Row i belongs to group `group[i]` (m,) and does not depend on the own
    unknowns of other groups. `steps` (p,) and `own_steps` (k,) are the step sizes of the numerical derivatives. A
    finite `prior_sd` (p,) holds a shared unknown near its start. Raises CalibrationRefused when the data do not
    determine some combination of unknowns.
    """
    start, own = np.array(shared, float), np.array(own, float)
    width, own_shape = len(start), own.shape
    prior = np.zeros(width) if prior_sd is None else np.where(np.isfinite(prior_sd), prior_sd, np.inf) ** -1.0
    rows = [np.flatnonzero(group == index) for index in range(int(group.max()) + 1)]

    def parts(unknown: Array) -> tuple[Array, Array]:
        return unknown[:width], unknown[width:].reshape(own_shape)

    def with_prior(unknown: Array) -> Array:
        return np.concatenate([residual(*parts(unknown)), prior * (unknown[:width] - start)])

    def jacobian(unknown: Array) -> Array:
        by_shared, by_own = _jacobians(residual, *parts(unknown), steps, own_steps)
        whole = np.zeros((len(by_shared) + width, len(unknown)))
        whole[: len(by_shared), :width] = by_shared
        for index, row in enumerate(rows):
            first = width + index * by_own.shape[1]
            whole[row, first : first + by_own.shape[1]] = by_own[row]
        whole[len(by_shared) :, :width] = np.diag(prior)
        return whole

    unknown = np.concatenate([start, own.ravel()])
    found = least_squares(
        with_prior, unknown, jac=jacobian, x_scale="jac", max_nfev=EVALUATIONS, ftol=DONE, xtol=DONE, gtol=DONE
    )
    shared, own = parts(found.x)
    by_shared, by_own = _jacobians(residual, shared, own, steps, own_steps)
    return _finished(residual(shared, own), shared, own, group, rows, by_shared, by_own, prior**2)


def _without_own(
    by_shared: Array, by_own: Array, right: Array, rows: list[NDArray[np.int64]]
) -> list[tuple[Array, Array]]:
    """The design matrix and right side of each group, with its own unknowns projected out."""
    found = []
    for row in rows:
        block, part = by_shared[row], right[row]
        if by_own.shape[1]:
            basis, _ = np.linalg.qr(by_own[row])
            block, part = block - basis @ (basis.T @ block), part - basis @ (basis.T @ part)
        found.append((block, part))
    return found


def _finished(
    now: Array, shared: Array, own: Array, group: NDArray[np.int64], rows: list[NDArray[np.int64]], by_shared: Array,
    by_own: Array, weight: Array,
) -> GroupedFit:  # fmt: skip
    groups = _without_own(by_shared, by_own, now, rows)
    reduced, pulls = [block.T @ block for block, _ in groups], [block.T @ part for block, part in groups]
    width = len(shared)
    if not width:
        return GroupedFit(shared, own, np.zeros((0, 0)), now, group)
    whole = np.sum(reduced, axis=0) + np.diag(weight)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(whole), 1e-300))
    if float(np.linalg.eigvalsh(whole * np.outer(scale, scale))[0]) < MIN_EIGENVALUE:
        raise CalibrationRefused("the data leave a combination of the unknowns open: take more that differ")
    covariance = np.zeros((width, width))
    for block, pull in zip(reduced, pulls, strict=True):
        left = (whole - block) * np.outer(scale, scale)
        left += np.diag(np.full(width, MIN_EIGENVALUE))
        moved = scale * np.linalg.solve(left, scale * pull)
        covariance += np.outer(moved, moved)
    count = len(rows)
    covariance *= (count - 1.0) / count
    if np.any(weight > 0.0):
        # an unknown held by the prior gets the standard deviation of prior and data together, no smaller and no larger
        inverse = np.linalg.inv(whole)
        covariance += inverse @ np.diag(weight) @ inverse
    return GroupedFit(shared, own, covariance, now, group)


def moved_by(
    changes: Array, residual: Residual, fit: GroupedFit, group: NDArray[np.int64], steps: Array, own_steps: Array
) -> Array:
    """How far the shared unknowns (p, q) of a fit move, to first order, when its residuals (m,) change by (m, q).

    This gives the effect of an error that all groups have in common, which leaving groups out cannot show.
    """
    by_shared, by_own = _jacobians(residual, fit.shared, fit.own, steps, own_steps)
    rows = [np.flatnonzero(group == index) for index in range(int(group.max()) + 1)]
    groups = _without_own(by_shared, by_own, changes, rows)
    whole = np.sum([block.T @ block for block, _ in groups], axis=0)
    pulled = np.sum([block.T @ part for block, part in groups], axis=0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(whole), 1e-300))
    return np.asarray(-scale[:, None] * np.linalg.solve(whole * np.outer(scale, scale), scale[:, None] * pulled))


def held_out_folds(groups: int, folds: int = 5) -> list[NDArray[np.int64]]:
    """Sets of groups to leave out together, every `folds`-th group; at least two groups always stay in."""
    folds = max(2, min(folds, groups))
    return [np.arange(first, groups, folds) for first in range(folds)]
