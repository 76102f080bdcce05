"""The fine fit: each profile across the rim is a step from face to chamfer and a step from chamfer to bore.

An edge's three greys are free and projected out (variable projection, Golub and Pereyra 1973, Kaufman's form); what is
left depends on the pose alone, 6-DoF Gauss-Newton over both pictures.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.coarse_fit import sample
from services.vision.rim_model import ProjectedRim, RimModel, normal_shift_jacobian, perturbed, project
from services.vision.stereo import StereoModel

# blur added to the pictures (px), and iterations with it: wide valleys first
STAGES = ((2.0, 4), (1.0, 4), (0.0, 8))
# a profile that fits worse than this many times the noise counts no worse
COST_CAP = 8.0
FACE_SIDE_PX = 3.5
BORE_SIDE_PX = 1.5
STEP_PX = 0.5
# lens blur and pixel, one Gaussian: sqrt(.7^2 + 1/12)
SPREAD_PX = 0.757
PRIOR_SD = np.array([0.03, 0.03, 0.04, 0.2, 0.2, 0.2])


Images = tuple[NDArray[np.float32], NDArray[np.float32]]


def _blurred(images: Images, blur_px: float) -> Images:
    left, right = (np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px), dtype=np.float32) for image in images)
    return left, right


@dataclass(frozen=True, slots=True, eq=False)
class ProfileFit:
    """The fine fit's end.

    information (6, 6) of the pose, by the noise alone; cost: mean square of the residual grey over the noise's;
    support (2, n, S): whether a profile looks like a rim; step_grey (2, n): face minus bore; edge_information
    (n, 6, 6): each edge's share; edge_lever (2, n, 6): pull on the pose of a whole edge of one picture, per pixel;
    edge_turn (2, n, 6): the same of an edge that is off by a pixel at its end and by minus one at its start.
    face_grey (2, n, S): grey beside the rim, on the face.
    """

    pose_camera_hole: Pose
    information: Array
    cost: float
    support: Array
    step_grey: Array
    edge_information: Array
    edge_lever: Array
    edge_turn: Array
    face_grey: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Normal:
    information: Array
    gradient: Array
    cost: float
    support: Array
    step_grey: Array
    edge_information: Array
    edge_lever: Array
    edge_turn: Array
    face_grey: Array


def _profiles(images: Images, rim: ProjectedRim, reach_px: float, blur_px: float) -> tuple[Array, Array]:
    offsets = np.arange(-FACE_SIDE_PX - 0.5 * blur_px, reach_px + BORE_SIDE_PX + 0.5 * blur_px + 1e-9, STEP_PX)
    points = rim.outer_px[..., None, :] + offsets[:, None] * rim.normal[..., None, :]
    return offsets, np.stack([sample(images[side], points[side]) for side in range(2)])


def _system(images: Images, rim: ProjectedRim, jacobian: Array, noise_grey: float, blur_px: float = 0.0) -> _Normal:
    """Normal equations in the parameters of `jacobian` (2, n, S, P): shift of the outer line along its normal, px."""
    parameters, edges = jacobian.shape[-1], jacobian.shape[1]
    chamfer = np.maximum(rim.chamfer_px, 0.0)
    offsets, grey = _profiles(images, rim, float(np.median(chamfer)), blur_px)
    spread = float(np.hypot(SPREAD_PX, blur_px))
    first = ndtr(offsets / spread) * np.ones_like(grey)
    second = ndtr((offsets - chamfer[..., None]) / spread)

    def slope(x: Array) -> Array:
        return np.asarray(np.exp(-0.5 * (x / spread) ** 2) / (spread * np.sqrt(2.0 * np.pi)))

    first_slope, second_slope = slope(offsets) * np.ones_like(grey), slope(offsets - chamfer[..., None])
    information, gradient = np.zeros((parameters, parameters)), np.zeros(parameters)
    edge_information = np.zeros((edges, parameters, parameters))
    edge_lever, edge_turn = np.zeros((2, edges, parameters)), np.zeros((2, edges, parameters))
    support = np.zeros(chamfer.shape, dtype=bool)
    step_grey = np.zeros((2, edges))
    squares, counted = 0.0, 0
    samples, length = grey.shape[2], grey.shape[3]
    ramp = np.linspace(-1.0, 1.0, samples)[:, None]
    # what lies inside the inner rim differs from profile to profile (lit wall, shadow, far side): its step is free in
    # each, and is projected out first
    into_bore = second / np.linalg.norm(second, axis=-1, keepdims=True)

    def without(values: Array) -> Array:
        return np.asarray(values - into_bore * np.sum(into_bore * values, axis=-1, keepdims=True))

    flat, plain = without(np.ones_like(grey)), without(grey)
    outer_step = without(first)
    for edge in range(edges):
        # one edge is one edge: both cameras see the same fall of light at it, each on its own level of face grey
        half = samples * length
        basis = np.zeros((2 * half, 3))
        basis[:half, 0], basis[half:, 1] = flat[0, edge].ravel(), flat[1, edge].ravel()
        basis[:, 2] = outer_step[:, edge].ravel()
        greys, *_ = np.linalg.lstsq(basis, plain[:, edge].ravel(), rcond=1e-3)
        residual = (plain[:, edge].ravel() - basis @ greys).reshape(2, samples, length)
        whole_basis = greys[:2, None, None] + greys[2] * first[:, edge]
        bore = np.sum(into_bore[:, edge] * (grey[:, edge] - whole_basis), axis=-1) / np.linalg.norm(
            second[:, edge], axis=-1
        )
        rms = np.sqrt(np.mean(residual**2, axis=2))
        scale = max(noise_grey, float(np.median(rms)))
        weight = np.clip(1.0 - (np.maximum(rms / scale - 1.0, 0.0) / 2.0) ** 2, 0.0, 1.0) ** 2
        step = -(greys[2] + bore)
        step_grey[:, edge] = np.median(step, axis=1)
        support[:, edge] = (rms < 3.0 * noise_grey + 0.05 * np.abs(step)) & (step > 4.0 * noise_grey)
        fall = -(greys[2] * first_slope[:, edge] + bore[..., None] * second_slope[:, edge])
        heavy = np.sqrt(np.repeat(weight.ravel(), length))
        q, _ = np.linalg.qr(basis * heavy[:, None])
        inner = into_bore[:, edge]
        fall = fall - inner * np.sum(inner * fall, axis=-1, keepdims=True)
        design = (fall[..., None] * jacobian[:, edge][:, :, None, :]).reshape(-1, parameters) * heavy[:, None]
        design = design - q @ (q.T @ design)
        edge_information[edge] = design.T @ design / scale**2
        information += edge_information[edge]
        gradient += design.T @ (residual.ravel() * heavy) / scale**2
        # the systematic part: a whole edge of one picture off by one pixel pulls the pose by this much
        for side in range(2):
            whole = np.zeros((2, half))
            whole[side] = fall[side].ravel()
            edge_lever[side, edge] = design.T @ (whole.ravel() * heavy) / scale**2
            whole[side] = (fall[side] * ramp).ravel()
            edge_turn[side, edge] = design.T @ (whole.ravel() * heavy) / scale**2
        squares += float(np.sum(np.minimum((rms / noise_grey) ** 2, COST_CAP**2)))
        counted += 2 * samples
    return _Normal(
        information,
        gradient,
        squares / counted,
        support,
        step_grey,
        edge_information,
        edge_lever,
        edge_turn,
        grey[..., 0],
    )


def profile_fit(images: Images, model: RimModel, stereo: StereoModel, start: Pose, noise_grey: float) -> ProfileFit:
    """The fine fit from a start, both images (height, width) float32."""
    pose = start
    damping = np.diag(PRIOR_SD**-2)
    for blur, iterations in STAGES:
        seen = images if blur == 0.0 else _blurred(images, blur)
        for _ in range(iterations):
            rim = project(model, stereo, pose)
            system = _system(seen, rim, normal_shift_jacobian(model, stereo, pose, rim), noise_grey, blur)
            step = np.asarray(np.linalg.solve(system.information + damping, system.gradient), dtype=float)
            # far from the rim the profile is flat and a step means nothing: never more than the coarse fit may be off
            step *= min(1.0, 0.002 / max(float(np.linalg.norm(step[:3])), 1e-12))
            pose = perturbed(pose, step)
            if np.linalg.norm(step[:3]) < 1e-6 and np.linalg.norm(step[3:]) < 1e-5:
                break
    rim = project(model, stereo, pose)
    system = _system(images, rim, normal_shift_jacobian(model, stereo, pose, rim), noise_grey)
    return ProfileFit(
        pose,
        system.information,
        system.cost,
        system.support,
        system.step_grey,
        system.edge_information,
        system.edge_lever,
        system.edge_turn,
        system.face_grey,
    )


def right_image_offset_px(
    images: Images, model: RimModel, stereo: StereoModel, fit: ProfileFit, noise_grey: float
) -> tuple[float, float]:
    """(du, dv), px: how far the right picture lies off its rows and off its disparity, by the size of the drawing."""
    rim = project(model, stereo, fit.pose_camera_hole)
    shift = np.zeros((*rim.normal.shape[:3], 2))
    shift[1] = rim.normal[1]
    du_px, dv_px = _extra(images, model, stereo, fit, rim, shift, noise_grey)
    return du_px, dv_px


def drawing_offset_m(
    images: Images, model: RimModel, stereo: StereoModel, fit: ProfileFit, noise_grey: float
) -> tuple[float, float]:
    """(near edges, far edges), m: how much larger the hole in the pictures is than the drawing's; of a cross its
    half-width and half-length. Where all edges are as far from the axis the two are one."""
    rim = project(model, stereo, fit.pose_camera_hole)
    delta = 1e-5
    ways = (model.grown(delta, 0.0), model.grown(0.0, delta)) if model.sizes == 2 else (model.grown(delta, delta),)
    shift = np.stack(
        [
            np.sum((project(grown, stereo, fit.pose_camera_hole).outer_px - rim.outer_px) * rim.normal, axis=-1) / delta
            for grown in ways
        ],
        axis=-1,
    )
    found = _extra(images, model, stereo, fit, rim, shift, noise_grey)
    return found[0], found[-1]


def _extra(
    images: Images, model: RimModel, stereo: StereoModel, fit: ProfileFit, rim: ProjectedRim, shift: Array,
    noise_grey: float,
) -> list[float]:  # fmt: skip
    """More parameters beside the pose, one Gauss-Newton step from the converged fit."""
    jacobian = normal_shift_jacobian(model, stereo, fit.pose_camera_hole, rim)
    system = _system(images, rim, np.concatenate([jacobian, shift], axis=-1), noise_grey)
    scale = np.sqrt(np.maximum(np.diag(system.information), 1e-12))
    step = np.linalg.solve(
        system.information / np.outer(scale, scale) + 1e-9 * np.eye(len(scale)), system.gradient / scale
    )
    step = step / scale
    return [float(value) for value in step[6:]]
