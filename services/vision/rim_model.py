"""The rim as lines in both pictures: 12 edges, each with its outer (face meets chamfer) and inner (chamfer meets bore)
line, sampled along its length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import CrossHole
from services.vision.stereo import StereoModel

SAMPLES = 20
SKIP_ENDS = 0.13


@dataclass(frozen=True, slots=True, eq=False)
class RimModel:
    """Points on the rim in the hole frame: outer and inner (12, SAMPLES, 3), m, and edge directions (12, 3)."""

    outer_m: Array
    inner_m: Array
    along: Array

    @classmethod
    def of(cls, hole: CrossHole) -> RimModel:
        """The rim of a hole; a share of each edge at its ends is left out, where the corner disturbs."""
        outer, inner = hole.outer_rim_m(), hole.inner_rim_m()
        ends = np.roll(inner, -1, axis=0)
        share = np.linspace(SKIP_ENDS, 1.0 - SKIP_ENDS, SAMPLES)[None, :, None]
        inner_points = inner[:, None, :] * (1.0 - share) + ends[:, None, :] * share
        along = ends - inner
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        # straight out from the inner point, across the chamfer, onto the face
        outward = np.column_stack([along[:, 1], -along[:, 0], np.zeros(12)])
        shift = outward * (np.abs(np.sum((outer - inner) * outward, axis=1)))[:, None]
        shift[:, 2] = outer[:, 2] - inner[:, 2]
        return cls(inner_points + shift[:, None, :], inner_points, along)

    def grown(self, width_m: float, length_m: float) -> RimModel:
        """The same rim with the arms wider and longer by these amounts (half-width, half-length), m."""
        moved = np.zeros((12, 3))
        for edge in range(12):
            outward = np.array([self.along[edge, 1], -self.along[edge, 0]])
            moved[edge, :2] = outward * (length_m if edge % 3 == 0 else width_m)
        return RimModel(self.outer_m + moved[:, None, :], self.inner_m + moved[:, None, :], self.along)


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedRim:
    """In both pictures: outer points (2, 12, S, 2), unit normals pointing into the hole (2, 12, S, 2), px, and the
    chamfer's width along the normal (2, 12, S), px."""

    outer_px: Array
    normal: Array
    chamfer_px: Array


def project(model: RimModel, stereo: StereoModel, pose_camera_hole: Pose) -> ProjectedRim:
    """The rim at a pose, as both cameras see it."""
    outer = stereo.project(pose_camera_hole.apply(model.outer_m))
    ahead = stereo.project(pose_camera_hole.apply(model.outer_m + 1e-4 * model.along[:, None, :]))
    inner = stereo.project(pose_camera_hole.apply(model.inner_m))
    tangent = ahead - outer
    tangent = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    width = np.sum((inner - outer) * normal, axis=-1)
    # seen nearly along the chamfer its width may vanish or turn; the normal must still point into the hole
    middle = model.outer_m.mean(axis=1)
    step_in = -np.cross(model.along, [0.0, 0.0, 1.0])
    inside = stereo.project(pose_camera_hole.apply(middle + 1e-3 * step_in)) - outer.mean(axis=2)
    flip = np.sign(np.sum(inside[:, :, None, :] * normal, axis=-1, keepdims=True))
    return ProjectedRim(outer, normal * flip, width * flip[..., 0])


def perturbed(pose: Pose, step: Array) -> Pose:
    """The pose moved by (x, y, z, rx, ry, rz) in its own frame."""
    return pose @ Pose.from_rotvec(step[3:], step[:3])


def normal_shift_jacobian(model: RimModel, stereo: StereoModel, pose: Pose, rim: ProjectedRim) -> Array:
    """(2, 12, S, 6): how far each outer point moves along its normal, px, for each of (x, y, z, rx, ry, rz)."""
    columns = []
    for axis in range(6):
        delta = 1e-5 if axis < 3 else 1e-4
        step = np.zeros(6)
        step[axis] = delta
        moved = stereo.project(perturbed(pose, step).apply(model.outer_m))
        columns.append(np.sum((moved - rim.outer_px) * rim.normal, axis=-1) / delta)
    return np.stack(columns, axis=-1)
