"""Refines starts that are a few pixels off: edges along the rim's normals in both pictures, in shrinking windows.

Iterated closest edges, Gauss-Newton in all six degrees of freedom, all starts at once. An edge's weight depends on how
far it stands out from the noise and from the rest of its profile, whatever its contrast and sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rotation import rotation_of
from services.vision.detect.picture_level import Floats, Level
from services.vision.detect.rim_samples import RimSamples
from services.vision.stereo import StereoModel

STEP_PX = 0.5
NEAR_SHARE = 0.6  # share of the window: an edge farther away counts clearly less
NOISE_SHARE = 1.5
AROUND_SHARE = 1.0
TUKEY = 4.685
MIN_SPREAD_PX = 0.35
# an edge may be seen at -1 (the chamfer's outer line), at 1 (its inner line) or between, the same all around the rim
LINE_SD = 1.0
# reach of the profile compared with two steps: beyond the outer and beyond the inner line; the blur of the steps
FACE_PX, BORE_PX = 3.5, 4.0
STEP_SPREAD_PX = 0.9
WIDTH_STEP_PX = 0.5
STEP_NOISE_SHARE = 1.0
MIN_STEPS = 0.3
MIN_UNEXPLAINED = 0.002
MIN_EDGE = 0.25  # a profile with less edge than this is not used
# neighbouring profiles see the same edge: by their scatter, only one in ten is independent
INDEPENDENT = 0.1
# an edge within this distance of the expected rim, px of the level, supports it
SUPPORT_PX = 1.25
SUPPORT_WINDOW_PX = 4.0
# cached tables of two steps, about 8 kB each; the cache is bounded because the sizes depend on the pictures
TABLES_KEPT = 64


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """K poses `pose_camera_hole`: rotations (K, 3, 3) and translations (K, 3), m."""

    rotation: Array
    translation_m: Array

    @classmethod
    def of(cls, poses: list[Pose]) -> Poses:
        return cls(np.array([pose.rotation for pose in poses]), np.array([pose.translation_m for pose in poses]))

    def __len__(self) -> int:
        return len(self.rotation)

    def __getitem__(self, index: int) -> Pose:
        return Pose(self.rotation[index], self.translation_m[index])

    def taken(self, which: list[int]) -> Poses:
        return Poses(self.rotation[which], self.translation_m[which])

    def apply(self, points_m: Array) -> Array:
        """(K, M, 3) of points (M, 3)."""
        return np.asarray(points_m @ np.swapaxes(self.rotation, 1, 2) + self.translation_m[:, None, :])

    def moved(self, steps: Array) -> Poses:
        """Each by its row of `steps` (K, 6): x, y, z, rx, ry, rz in its own frame."""
        turn = Rotation.from_rotvec(steps[:, 3:]).as_matrix()
        shift = np.einsum("kij,kj->ki", self.rotation, steps[:, :3])
        return Poses(self.rotation @ turn, self.translation_m + shift)

    def from_prior(self, prior: Pose) -> Array:
        """(K, 6): the difference of each pose from the prior, in the prior's frame, m and rad."""
        turn = rotation_of(prior.rotation.T @ self.rotation).as_rotvec()
        return np.column_stack([(self.translation_m - prior.translation_m) @ prior.rotation, turn])


@dataclass(frozen=True, slots=True, eq=False)
class RimEdges:
    """K rims in both pictures, px of the levels: `outer_px` (2, K, M, 2), `normal` (2, K, M, 2) into the hole,
    `chamfer_px` (2, K, M) along it, `slope` (2, K, M, 6): how far the middle of the chamfer moves along the normal."""

    outer_px: Array
    normal: Array
    chamfer_px: Array
    slope: Array

    @classmethod
    def of(cls, samples: RimSamples, stereo: StereoModel, poses: Poses, levels: tuple[Level, Level]) -> RimEdges:
        middle_m, delta = samples.at(0.5), 1e-5
        in_camera = poses.apply(middle_m)
        rows = [in_camera, poses.apply(samples.outer_m), poses.apply(samples.inner_m)]
        rows += [in_camera + delta * axis for axis in np.eye(3)]
        projected = stereo.project(np.stack(rows))
        seen = np.stack([level.to_level(projected[side]) for side, level in enumerate(levels)], axis=1)
        middle, outer, inner = seen[:3]
        by_point = np.moveaxis((seen[3:] - middle) / delta, 0, -1)  # (2, K, M, 2, 3)
        by_frame = by_point @ poses.rotation[None, :, None]
        tangent = np.einsum("skmij,mj->skmi", by_frame, samples.along)
        tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
        normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
        inward = np.column_stack([-samples.along[:, 1], samples.along[:, 0], np.zeros(len(samples.along))])
        towards = np.einsum("skmij,mj,skmi->skm", by_frame, inward, normal)
        normal *= np.sign(towards)[..., None]
        along_normal = np.einsum("skmi,skmij->skmj", normal, by_frame)
        (x, y, z), (by_x, by_y, by_z) = middle_m.T, np.moveaxis(along_normal, -1, 0)
        turning = np.stack([y * by_z - z * by_y, z * by_x - x * by_z, x * by_y - y * by_x], axis=-1)
        if samples.round:
            turning[..., 2] = 0.0
        width = np.maximum(np.sum((inner - outer) * normal, axis=-1), 0.0)
        return cls(outer, normal, width, np.concatenate([along_normal, turning], axis=-1))


def edges_along(levels: tuple[Level, Level], samples: RimSamples, rim: RimEdges, offsets_px: Array) -> Array:
    """(2, K, M, T): 0 to 1, how much of an edge each profile has at `offsets_px` (T,) from the chamfer's middle."""
    start = rim.outer_px + 0.5 * rim.chamfer_px[..., None] * rim.normal
    points = start[..., None, :] + offsets_px[:, None] * rim.normal[..., None, :]
    share = np.empty(points.shape[:-1])
    for side, level in enumerate(levels):
        rows = points[side].reshape(-1, len(offsets_px), 2).astype(np.float32)
        gradient = _sampled(level.gradient, rows, cv2.BORDER_CONSTANT).reshape(points.shape[1:])
        normal = rim.normal[side][..., None, :].astype(np.float32)
        across = gradient[..., 0] * normal[..., 0] + gradient[..., 1] * normal[..., 1]
        size = gradient[..., 0] ** 2 + gradient[..., 1] ** 2 + np.float32(1e-6)
        along = samples.smooth.astype(np.float32) @ (across * across * across / size)
        height = np.abs(along)
        around = AROUND_SHARE * height.mean(axis=-1, keepdims=True) + NOISE_SHARE * level.noise
        share[side] = height / (height + around)
    return share


def steps_along(levels: tuple[Level, Level], samples: RimSamples, rim: RimEdges, offsets_px: Array) -> Array:
    """(2, K, M, T): 0 to 1, the share of each profile explained by two steps, one at each line of the chamfer, with the
    rim shifted inward by `offsets_px` (T,). The greys of face, chamfer and bore and a slope are free."""
    width = rim.chamfer_px
    widest = float(width.max())
    reach = _offsets_between(float(offsets_px[0]) - FACE_PX, float(offsets_px[-1]) + widest + BORE_PX)
    points = rim.outer_px[..., None, :] + reach[:, None] * rim.normal[..., None, :]
    share = np.empty((*width.shape, len(offsets_px)))
    kinds = np.rint(width / WIDTH_STEP_PX).astype(int)
    for side, level in enumerate(levels):
        rows = points[side].reshape(-1, len(reach), 2).astype(np.float32)
        ends = rim.outer_px[side], rim.outer_px[side] + width[side][..., None] * rim.normal[side]
        seen = level.holds(ends[0]) & level.holds(ends[1])
        grey = _sampled(level.grey, rows, cv2.BORDER_REPLICATE).reshape(points.shape[1:-1])
        grey = samples.smooth.astype(np.float32) @ grey
        for kind in np.unique(kinds[side]):
            which = kinds[side] == kind
            profiles = grey[which]
            profiles = profiles - profiles.mean(axis=1, keepdims=True)
            steps, inside = _two_steps(float(kind) * WIDTH_STEP_PX, len(reach), len(offsets_px))
            explained = np.sum((profiles @ steps).reshape(len(profiles), len(offsets_px), -1) ** 2, axis=-1)
            length = np.sum(inside[:, 0])
            energy = (profiles * profiles) @ inside - (profiles @ inside) ** 2 / length
            noise = np.float32(length * (STEP_NOISE_SHARE * level.grey_noise) ** 2)
            share[side][which] = explained / (np.maximum(energy, explained) + noise)
        share[side] *= seen[..., None]
    return share


@lru_cache(maxsize=TABLES_KEPT)
def _two_steps(width_px: float, reach: int, offsets: int) -> tuple[Floats, Floats]:
    """For profiles of `reach` points and the rim at each of `offsets` places on them: (reach, offsets * 2) orthonormal
    bases of a rim with a chamfer of this width, without its mean, and (reach, offsets) the points that each one
    uses."""
    at = _offsets_between(-FACE_PX, width_px + BORE_PX)
    columns = [ndtr(at / STEP_SPREAD_PX), ndtr((at - width_px) / STEP_SPREAD_PX)]
    left, size, _ = np.linalg.svd(np.column_stack([c - c.mean() for c in columns]), full_matrices=False)
    left = left * (size > 0.05 * size[0])
    steps, inside = np.zeros((reach, offsets, 2)), np.zeros((reach, offsets))
    for index in range(offsets):
        steps[index : index + len(at), index] = left
        inside[index : index + len(at), index] = 1.0
    return steps.reshape(reach, -1).astype(np.float32), inside.astype(np.float32)


def refined(
    levels: tuple[Level, Level],
    samples: RimSamples,
    stereo: StereoModel,
    poses: Poses,
    prior: Pose,
    half_ranges: Array,
    windows_px: tuple[float, ...],
    by_steps: bool = False,
) -> Poses:
    """The poses after one step a window (px of the levels).

    Each profile's edge may be anywhere across the chamfer, the same all around; with `by_steps`, both lines of the
    chamfer are fitted.
    """
    line = np.zeros(len(poses))
    spread_of = np.append(half_ranges, LINE_SD)
    for window in windows_px:
        rim = RimEdges.of(samples, stereo, poses, levels)
        half = 0.5 * rim.chamfer_px
        if by_steps:
            offsets = _offsets(window)
            share = steps_along(levels, samples, rim, offsets)
            beyond = np.abs(offsets)
        else:
            offsets = _offsets(window + float(half.max()))
            share = edges_along(levels, samples, rim, offsets)
            beyond = np.maximum(np.abs(offsets) - half[..., None], 0.0)
        # two steps explain much even a little off the rim, so the weight comes from the unexplained part
        likely = share / (1.0 + MIN_UNEXPLAINED - share) if by_steps else share
        likely = likely * np.exp(-0.5 * (beyond / (NEAR_SHARE * window)) ** 2)
        best = np.clip(np.argmax(likely, axis=-1), 1, len(offsets) - 2)[..., None]
        before, middle, after = (np.take_along_axis(likely, best + k, -1)[..., 0] for k in (-1, 0, 1))
        bend = np.minimum(before - 2.0 * middle + after, -1e-6)
        found = offsets[best[..., 0]] + STEP_PX * np.clip(0.5 * (before - after) / bend, -1.0, 1.0)
        edge = np.take_along_axis(share, best, -1)[..., 0]
        residual = found if by_steps else found - line[:, None] * half
        strong = np.where(edge > (MIN_STEPS if by_steps else MIN_EDGE), edge, 0.0)
        size = np.sort(np.where(strong > 0.0, np.abs(residual), np.inf).transpose(1, 0, 2).reshape(len(poses), -1))
        median = size[np.arange(len(poses)), np.sum(np.isfinite(size), axis=1) // 2]
        scale = np.clip(1.4826 * median, MIN_SPREAD_PX, window)
        weight = strong * (1.0 - np.clip(residual / (TUKEY * scale[:, None]), -1.0, 1.0) ** 2) ** 2
        slope = np.concatenate([rim.slope, half[..., None] * float(not by_steps)], axis=-1)
        weighted = slope * weight[..., None]
        worth = INDEPENDENT / scale**2
        information = worth[:, None, None] * np.einsum("skmi,skmj->kij", weighted, slope) + np.diag(spread_of**-2.0)
        pull = -np.column_stack([poses.from_prior(prior), line]) / spread_of**2
        gradient = worth[:, None] * np.einsum("skmi,skm->ki", weighted, residual) + pull
        steps = np.linalg.solve(information, gradient[..., None])[..., 0]
        poses, line = poses.moved(steps[:, :6]), np.clip(line + steps[:, 6], -1.0, 1.0)
    return poses


def support(levels: tuple[Level, Level], samples: RimSamples, stereo: StereoModel, poses: Poses) -> Floats:
    """(2, K, M): 0 to 1, the edge strength at each sample of the rim, on either line of its chamfer."""
    rim = RimEdges.of(samples, stereo, poses, levels)
    half = 0.5 * rim.chamfer_px
    offsets = _offsets(SUPPORT_WINDOW_PX + float(half.max()))
    share = edges_along(levels, samples, rim, offsets)
    beyond = np.maximum(np.abs(offsets) - half[..., None], 0.0)
    return np.asarray(np.max(share * np.exp(-0.5 * (beyond / SUPPORT_PX) ** 2), axis=-1), dtype=np.float32)


def likeness(levels: tuple[Level, Level], samples: RimSamples, stereo: StereoModel, poses: Poses) -> Floats:
    """(2, K, M): 0 to 1, how well two steps explain each profile of the rim, at most half a pixel off."""
    rim = RimEdges.of(samples, stereo, poses, levels)
    return np.asarray(np.max(steps_along(levels, samples, rim, _offsets(STEP_PX)), axis=-1), dtype=np.float32)


def _sampled(picture: Floats, rows_px: Floats, beyond: int) -> Floats:
    """Bilinear samples of a picture (height, width) or (height, width, n) at points (rows, columns, 2), px."""
    found = cv2.remap(picture, rows_px[..., 0], rows_px[..., 1], cv2.INTER_LINEAR, borderMode=beyond)
    return np.asarray(found, dtype=np.float32)


def _offsets_between(low_px: float, high_px: float) -> Array:
    return np.asarray(low_px + STEP_PX * np.arange(int(np.ceil((high_px - low_px) / STEP_PX)) + 1), dtype=float)


def _offsets(reach_px: float) -> Array:
    count = int(np.ceil(reach_px / STEP_PX))
    return np.asarray(STEP_PX * np.arange(-count, count + 1), dtype=float)
