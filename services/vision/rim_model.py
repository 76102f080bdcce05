"""The rim as lines in both pictures: n edges, each with its outer (face meets chamfer) and inner (chamfer meets bore)
line, sampled along its length. Any outline: the paper's cross has 12 edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.stereo import StereoModel

PROFILES = 240  # across the whole rim, a picture
SAMPLES_LEAST = 4
SKIP_ENDS = 0.13
SKIP_ENDS_M = 0.0015  # of a short edge: two pixels from a corner its profiles are disturbed
SKIP_ENDS_MOST = 0.4
SMOOTH_RAD = 0.2  # edges that turn by less are facets of a curve: nothing disturbs where they meet
SAME_DIRECTION = 0.02


class Rimmed(Protocol):
    """A hole with its chamfer: corners of the rim, counter-clockwise, hole frame, m."""

    def inner_rim_m(self) -> Array:
        """(n, 3) where the chamfer meets the bore."""

    def outer_rim_m(self) -> Array:
        """(n, 3) where the face meets the chamfer."""


@dataclass(frozen=True, slots=True, eq=False)
class RimModel:
    """Points on the rim in the hole frame: outer and inner (n, S, 3), m, edge directions (n, 3), and how far out each
    edge lies (n,), 0 the nearest to the axis and 1 the farthest."""

    outer_m: Array
    inner_m: Array
    along: Array
    reach: Array

    @classmethod
    def of(cls, hole: Rimmed) -> RimModel:
        """The rim of a hole; a share of each edge at its ends is left out, where the corner disturbs."""
        outer, inner = hole.outer_rim_m(), hole.inner_rim_m()
        ends = np.roll(inner, -1, axis=0)
        edges = len(inner)
        samples = max(SAMPLES_LEAST, PROFILES // edges)
        along = ends - inner
        length = np.linalg.norm(along, axis=1, keepdims=True)
        along = along / length
        corner = np.clip(SKIP_ENDS_M / length, SKIP_ENDS, SKIP_ENDS_MOST)
        skip = np.where(_turns(along) < SMOOTH_RAD, 0.5 / samples, corner)
        share = np.linspace(skip[:, 0], 1.0 - skip[:, 1], samples, axis=1)[:, :, None]
        inner_points = inner[:, None, :] * (1.0 - share) + ends[:, None, :] * share
        # straight out from the inner point, across the chamfer, onto the face
        outward = np.column_stack([along[:, 1], -along[:, 0], np.zeros(edges)])
        shift = outward * (np.abs(np.sum((outer - inner) * outward, axis=1)))[:, None]
        shift[:, 2] = outer[:, 2] - inner[:, 2]
        away = np.sum(inner * outward, axis=1)
        span = float(np.ptp(away))
        reach = (away - away.min()) / span if span > 1e-6 else np.zeros(edges)
        return cls(inner_points + shift[:, None, :], inner_points, along, reach)

    @property
    def round(self) -> bool:
        """Whether nothing on the rim tells a turn about the axis: smooth all around and everywhere as far from it."""
        return bool(np.all(_turns(self.along) < SMOOTH_RAD)) and not self.reach.any()

    @property
    def sizes(self) -> int:
        """How many sizes can be checked against the drawing: near and far edges, or one where all are as far."""
        return 2 if self.reach.any() else 1

    def grown(self, near_m: float, far_m: float) -> RimModel:
        """The same rim with its edges farther out: those nearest to the axis by `near_m`, the farthest by `far_m`, m.

        Of a cross these are the half-width and the half-length of its arms.
        """
        out = near_m + (far_m - near_m) * self.reach
        moved = np.column_stack([self.along[:, 1] * out, -self.along[:, 0] * out, np.zeros(len(out))])
        return RimModel(self.outer_m + moved[:, None, :], self.inner_m + moved[:, None, :], self.along, self.reach)

    def facing(self) -> Array:
        """(n,) int: a number a direction; edges that face the same way share one."""
        outward = np.column_stack([self.along[:, 1], -self.along[:, 0]])
        numbers = np.full(len(outward), -1)
        for edge in range(len(outward)):
            same = np.linalg.norm(outward[:edge] - outward[edge], axis=1) < SAME_DIRECTION
            numbers[edge] = numbers[int(np.argmax(same))] if same.any() else numbers.max() + 1
        return numbers


def _turns(along: Array) -> Array:
    """(n, 2): by how much, rad, the rim turns at the start and at the end of each edge."""
    cosine = np.clip(np.sum(along * np.roll(along, 1, axis=0), axis=1), -1.0, 1.0)
    start = np.arccos(cosine)
    return np.column_stack([start, np.roll(start, -1)])


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedRim:
    """In both pictures: outer points (2, n, S, 2), unit normals pointing into the hole (2, n, S, 2), px, and the
    chamfer's width along the normal (2, n, S), px."""

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
    """(2, n, S, 6): how far each outer point moves along its normal, px, for each of (x, y, z, rx, ry, rz)."""
    columns = []
    for axis in range(6):
        delta = 1e-5 if axis < 3 else 1e-4
        step = np.zeros(6)
        step[axis] = delta
        moved = stereo.project(perturbed(pose, step).apply(model.outer_m))
        column = np.sum((moved - rim.outer_px) * rim.normal, axis=-1) / delta
        # the facets of a round rim are the drawing's, not the hole's
        columns.append(np.zeros_like(column) if axis == 5 and model.round else column)
    return np.stack(columns, axis=-1)
