"""The rotation of the sensor against the peg frame, from the weight it carries, because a payload's weight points
down."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from crosspih_common.geometry.pose import Array
from services.inference.cell_refinement.assemblies import Weighing

MIN_SD_N = 0.003
MIN_POSES = 5


def sensor_turn(weighings: Sequence[Weighing], prior_sd_rad: Array) -> tuple[Array, Array] | None:
    """The rotation vector (3,), rad, of the sensor's axes in the peg frame, and its covariance (3, 3).

    f = b + R_s^T R^T w for dwells with known R: the turn R_s, a weight w in the base and a bias b a calibration are
    fitted. The base may be tilted, so w is free. None without a calibration of at least 5 poses.
    """
    used = [one for one in weighings if len(one.force_n) >= MIN_POSES]
    if not used:
        return None

    def residual(x: Array) -> Array:
        turned = Rotation.from_rotvec(x[:3]).as_matrix()
        parts = [x[:3] / prior_sd_rad]
        for index, one in enumerate(used):
            weight, bias = x[3 + 6 * index : 6 + 6 * index], x[6 + 6 * index : 9 + 6 * index]
            expected = np.einsum("nji,j->ni", one.rotation_base_peg, weight) @ turned + bias
            parts.append(((one.force_n - expected) / np.hypot(one.sd_n, MIN_SD_N)).ravel())
        return np.concatenate(parts)

    start = np.zeros(3 + 6 * len(used))
    for index, one in enumerate(used):
        design = np.concatenate(
            [np.swapaxes(one.rotation_base_peg, 1, 2), np.broadcast_to(np.eye(3), (len(one.force_n), 3, 3))], axis=2
        )
        solved, *_ = np.linalg.lstsq(design.reshape(-1, 6), one.force_n.ravel(), rcond=None)
        start[3 + 6 * index : 9 + 6 * index] = solved
    fit = least_squares(residual, start, loss="soft_l1", f_scale=3.0, x_scale="jac")
    count = sum(one.force_n.size for one in used)
    birge = max(1.0, 2.0 * float(fit.cost) / max(count - 6 * len(used), 1))
    jacobian = np.asarray(fit.jac, dtype=np.float64)
    covariance = np.asarray(np.linalg.inv(jacobian.T @ jacobian)[:3, :3] * birge, dtype=np.float64)
    return np.asarray(fit.x[:3], dtype=np.float64), covariance
