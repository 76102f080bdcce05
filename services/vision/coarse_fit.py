"""The first fit: strongest falls of grey along the rim's normals, in shrinking windows, to within about a pixel."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.rim_model import RimModel, normal_shift_jacobian, perturbed, project
from services.vision.stereo import StereoModel

WINDOWS_PX = (8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.5, 2.5)
STEP_PX = 0.5
# prior of the coarse fit, one sd: keeps what few edges cannot say from running away (m and rad)
PRIOR_SD = np.array([0.02, 0.02, 0.03, 0.12, 0.12, 0.12])


def sample(image: NDArray[np.float32], points_px: Array) -> Array:
    """Grey at points (..., 2), px, cubic interpolation; beyond the border the border's grey."""
    # remap wants its maps below 32768 in each direction: a row a profile
    rows = points_px.reshape(-1, points_px.shape[-2], 2).astype(np.float32)
    grey = cv2.remap(image, rows[..., 0], rows[..., 1], interpolation=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(grey, dtype=float).reshape(points_px.shape[:-1])


def coarse_fit(
    images: tuple[NDArray[np.float32], NDArray[np.float32]],
    model: RimModel,
    stereo: StereoModel,
    start: Pose,
    noise_grey: float,
    chamfer_share: float = 0.5,
) -> Pose:
    """`pose_camera_hole` after the gradient fit of both images (height, width), float32, from a start.

    `chamfer_share` says where on the chamfer the steepest fall is taken to lie: 0 its outer line, 1 its inner one.
    """
    pose, prior = start, start
    for window in WINDOWS_PX:
        rim = project(model, stereo, pose)
        offsets = np.arange(-window, window + 1.0, STEP_PX)
        points = rim.outer_px[..., None, :] + offsets[:, None] * rim.normal[..., None, :]
        grey = np.stack([sample(images[side], points[side]) for side in range(2)])
        fall = grey[..., :-2] - grey[..., 2:]
        # near first: a far stronger edge is rather another one
        fall = fall * np.exp(-0.5 * (offsets[1:-1] / (0.7 * window)) ** 2)
        best = np.argmax(fall, axis=-1)
        height = np.take_along_axis(fall, best[..., None], axis=-1)[..., 0]
        inner = np.clip(best, 1, fall.shape[-1] - 2)
        left, middle, right = (np.take_along_axis(fall, (inner + k)[..., None], -1)[..., 0] for k in (-1, 0, 1))
        bend = left - 2.0 * middle + right
        sub = np.where(np.abs(bend) > 1e-6, 0.5 * (left - right) / np.where(np.abs(bend) > 1e-6, bend, 1.0), 0.0)
        found = offsets[1:-1][inner] + STEP_PX * np.clip(sub, -1.0, 1.0)
        residual = found - chamfer_share * np.maximum(rim.chamfer_px, 0.0)
        strong = height > 4.0 * noise_grey
        scale = max(1.4826 * float(np.median(np.abs(residual[strong]))), 0.4) if np.any(strong) else 1.0
        share = np.clip(residual / (4.685 * scale), -1.0, 1.0)
        weight = np.where(strong, (1.0 - share**2) ** 2, 0.0)
        jacobian = normal_shift_jacobian(model, stereo, pose, rim).reshape(-1, 6)
        weighted = jacobian * weight.reshape(-1, 1)
        to_prior = pose.inverse() @ prior
        pull = np.concatenate([to_prior.translation_m, to_prior.rotvec_rad()])
        # some 480 profiles but far fewer independent ones: a pixel each, one in ten
        information = 0.1 * weighted.T @ jacobian + np.diag(PRIOR_SD**-2)
        gradient = 0.1 * weighted.T @ residual.ravel() + pull / PRIOR_SD**2
        pose = perturbed(pose, np.linalg.solve(information, gradient))
    return pose
