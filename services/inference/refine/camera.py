"""Where the left camera really is, from the holes as it saw them and the holes as they were felt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.inference.refine.assemblies import Seen

F_SCALE = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class FeltHole:
    """A hole found without vision: pose and what is known of it, `information` (6, 6) (right perturbation)."""

    pose_base_hole: Pose
    information: Array


@dataclass(frozen=True, slots=True, eq=False)
class CameraFit:
    """The correction as a vector (6,): translation, m, then rotation vector, rad, in the camera's own frame;
    covariance (6, 6); root mean square of the residuals before and after, in sds."""

    correction: Array
    covariance: Array
    rms_before: float
    rms_after: float


def _error(first: Pose, second: Pose) -> Array:
    between = first.inverse() @ second
    return np.concatenate([between.translation_m, between.rotvec_rad()])


def _known(felt: FeltHole, seen: Seen, scale: Array) -> tuple[Array, Array]:
    """The directions (k, 6) in which a felt hole is known at all, and the factor (k, k) that whitens the error there.

    A direction that only the fit's own start held tells nothing of the camera.
    """
    values, vectors = np.linalg.eigh(felt.information * np.outer(scale, scale))
    keep = values > 1.0
    rows = (vectors[:, keep] / scale[:, None]).T
    covariance = rows @ seen.covariance @ rows.T + np.diag(1.0 / values[keep])
    return rows, np.linalg.inv(np.linalg.cholesky(covariance))


def camera_fit(holes: Sequence[tuple[Seen, FeltHole]], before: Array, prior_sd: Array, scale: Array) -> CameraFit:
    """Robust weighted least squares. before (6,): the correction in use; prior_sd (6,): of the camera's mounting;
    scale (6,): how well a hole is known without touching, m and rad. ValueError without holes."""
    if not holes:
        raise ValueError("camera_fit wants at least one hole that was both seen and felt")
    known = [_known(felt, seen, scale) for seen, felt in holes]

    def residual(x: Array) -> Array:
        correction = Pose.from_rotvec(x[3:], x[:3])
        parts = [x / prior_sd]
        for (seen, felt), (rows, whiten) in zip(holes, known, strict=True):
            pose = seen.pose_base_camera @ correction @ seen.pose_camera_hole
            parts.append(whiten @ (rows @ _error(pose, felt.pose_base_hole)))
        return np.concatenate(parts)

    def rms(x: Array) -> float:
        rest = residual(x)[6:]
        return float(np.sqrt(np.mean(rest**2))) if len(rest) else 0.0

    fit = least_squares(residual, np.asarray(before, float), loss="soft_l1", f_scale=F_SCALE, x_scale=prior_sd)
    freedom = max(len(residual(fit.x)) - 12, 1)
    birge = max(1.0, 2.0 * float(fit.cost) / freedom)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * birge
    return CameraFit(np.asarray(fit.x), covariance, rms(np.asarray(before, float)), rms(fit.x))
