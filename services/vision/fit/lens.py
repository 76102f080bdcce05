"""The effect of a miscalibrated lens on the pose, and what the rim and straight edges tell about such a lens.

A k1 missing in the calibration moves the image of (x, y) = (X/Z, Y/Z) by k1 (x^2 + y^2) (x, y) f. Around the rim that
is nearly a shift, and the fit takes it for another pose: mostly for another depth. No pair of pictures of one rim can
separate the two, so the uncertainty of k1 goes into the covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import DistortionModel
from services.vision.fit.rim import Rim
from services.vision.fit.solve import EDGE, POSE, TURN, Doubts, Fit, in_whole
from services.vision.stereo import StereoModel
from services.vision.straightness import Lenses

ALIKE = 0.8  # correlation of the two lenses' k1: mostly two lenses of one type


@dataclass(frozen=True, slots=True, eq=False)
class LensDoubt:
    """The k1 (2,) of the left and the right lens beyond their calibration, its covariance (2, 2), and the error of the
    fit's pose per unit of each, `by_k1` (6, 2): x, y, z, rx, ry, rz of the hole's frame, m and rad."""

    k1: Array
    k1_covariance: Array
    by_k1: Array

    def of_pose(self) -> Array:
        """(6, 6): the addition to the pose's covariance. The pose is not corrected, so the mean counts as an error,
        too."""
        return np.asarray(self.by_k1 @ (self.k1_covariance + np.outer(self.k1, self.k1)) @ self.by_k1.T)


def lens_doubt(fit: Fit, rim: Rim, stereo: StereoModel, doubts: Doubts, lenses: Lenses) -> LensDoubt:
    """From the prior of a lens, the rim, and the straight edges `lenses`. Where the edges are sure, `stereo` already
    includes their correction, and only their own uncertainty remains."""
    by_k1, information, pull = _by_k1(fit, rim, stereo)
    seen, seen_sd = lenses.by_side()
    if lenses.sure:
        covariance = np.asarray(np.linalg.inv(np.diag(seen_sd**-2) + information), dtype=float)
        return LensDoubt(covariance @ pull, covariance, by_k1)
    sd = np.array([
        doubts.k1_untold_sd if camera.distortion_model is DistortionModel.NONE else doubts.k1_sd
        for camera in stereo.cameras
    ])  # fmt: skip
    sd = np.maximum(sd, 1e-9)
    known = np.linalg.inv(np.outer(sd, sd) * np.array([[1.0, ALIKE], [ALIKE, 1.0]])) + information
    covariance = np.asarray(np.linalg.inv(known + np.diag(seen_sd**-2)), dtype=float)
    return LensDoubt(covariance @ (pull + seen * seen_sd**-2), covariance, by_k1)


def _by_k1(fit: Fit, rim: Rim, stereo: StereoModel) -> tuple[Array, Array, Array]:
    """The pose's error per k1 of each lens (6, 2); the rim's own information on both k1 (2, 2), and its pull (2,)."""
    ramp = np.linspace(-1.0, 1.0, rim.shape[1])
    across = np.zeros((2, rim.shape[0], fit.local.shape[-1]))
    rows, own, pull = [], np.zeros(2), np.zeros(2)
    for side, camera in enumerate(stereo.cameras):
        slopes = np.nan_to_num(camera.slopes(fit.seen.outer_px[side]))
        moved = slopes * np.sum(slopes**2, axis=-1, keepdims=True) * np.array([camera.fx_px, camera.fy_px])
        along_normal = np.sum(moved * fit.seen.normal[side], axis=-1)
        # an edge moves and turns as a whole; its bow is smaller than its own unevenness
        across[side, :, EDGE] = along_normal.mean(axis=1)
        across[side, :, TURN] = along_normal @ ramp / (ramp @ ramp)
        local = np.zeros_like(across)
        local[side] = np.einsum("gmn,gn->gm", fit.local[side], across[side])
        own[side] = float(np.sum(local[side] * across[side]))
        pull[side] = float(np.sum(fit.gradient[side] * across[side]))
        rows.append(in_whole(rim, local))
    shared = np.stack(rows, axis=1)
    taken = fit.covariance @ shared
    information = np.diag(own) - shared.T @ taken
    return taken[:POSE], 0.5 * (information + information.T), pull - shared.T @ fit.effects
