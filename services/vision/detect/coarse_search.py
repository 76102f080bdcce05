"""Coarse search: finds where in the prior both pictures show edges that run as the rim does.

Shape-based matching with quantised, spread orientations (Hinterstoisser et al., LINEMOD, 2012; Steger 2002 for edges of
either contrast). Both pictures are scored together: the right pose explains both.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.detect.picture_level import Floats, Level, Window
from services.vision.detect.rim_samples import RimSamples
from services.vision.stereo import StereoModel

BINS = 8
EXTENT_PX = 38.0  # of the rim in the coarse picture
STEP_PX = 1.5  # by which the rim's farthest point moves from one turn, or one depth, to the next
MAX_STEPS = 15
MARGIN_PX = 3
# an edge counts fully when it stands out from the noise, and from equally steep edges around it (texture)
NOISE_SHARE = 2.0
AROUND_SHARE = 1.0
AROUND_PX = 11
SHARE = 0.5  # of the chamfer: it is not yet known which of its two lines is seen
APART = (1, 1, 2, 2)  # least distance of two starts: depth, turn, and two across, in steps
POOL = 600


@dataclass(frozen=True, slots=True, eq=False)
class SearchGrid:
    """The poses to test, `pose_camera_hole`: turned and shifted along the axis (D, T), each with the rim's points (2,
    D, T, M, 2) in the pictures, px, their orientation bin (2, D, T, M), and the shift of its centre (2, D, G, G, 2),
    px, when it moves across by `across_m` (G,), with x as the last grid axis."""

    along_m: Array
    turns_rad: Array
    across_m: tuple[Array, Array]
    points_px: Array
    bins: NDArray[np.int64]
    shifts_px: Array
    factors: tuple[int, int]
    nominal: Pose

    @classmethod
    def of(cls, samples: RimSamples, stereo: StereoModel, nominal: Pose, half_ranges: Array) -> SearchGrid:
        """`nominal` is `pose_camera_hole` by the prior, `half_ranges` (6,) its uncertainty, m and rad."""
        rim = samples.at(SHARE)
        seen = stereo.project(nominal.apply(rim))
        extent = np.ptp(seen, axis=1).max(axis=1)
        factors = tuple(max(1, round(float(size) / EXTENT_PX)) for size in extent)
        scale = np.array(factors)[:, None]
        ends = stereo.project(nominal.apply(_on_axes(half_ranges)))  # (2, 6, 2): -x, x, -y, y, -z, z
        apart = np.linalg.norm(ends[:, 1::2] - ends[:, 0::2], axis=-1) / scale  # (2, 3) coarse px
        # along the axis the two centres move in opposite directions; a shift across takes up half of it
        drift = (ends[0, 5] - ends[0, 4]) / factors[0] - (ends[1, 5] - ends[1, 4]) / factors[1]
        depths = _steps(max(0.5 * float(np.linalg.norm(drift)), float(apart[:, 2].max()) * 0.25))
        radius = float((extent / np.array(factors)).max()) * 0.5
        turns = 1 if samples.round else _steps(2.0 * half_ranges[5] * radius)
        along = _grid(half_ranges[2], depths)
        turned = _grid(half_ranges[5], turns)
        across = tuple(_grid(half_ranges[axis], int(np.ceil(apart[:, axis].max())) + 1) for axis in range(2))
        poses = [[nominal @ Pose.from_rotvec([0, 0, r], [0, 0, z]) for r in turned] for z in along]
        points = np.array([[pose.apply(rim) for pose in row] for row in poses])
        ahead = np.array([[pose.apply(rim + 1e-4 * samples.along) for pose in row] for row in poses])
        points_px = stereo.project(points)
        direction = stereo.project(ahead) - points_px
        angle = np.arctan2(direction[..., 0], -direction[..., 1])  # of the normal
        bins = np.rint(angle / (np.pi / BINS)).astype(int) % BINS
        x, y = np.meshgrid(*across, indexing="xy")
        centres = np.stack([x, y, np.zeros_like(x)], axis=-1)
        depths_m = along[:, None, None, None] * np.array([0.0, 0.0, 1.0])
        moved, middle = nominal.apply(centres + depths_m), nominal.apply(depths_m)
        shifts = stereo.project(moved) - stereo.project(middle)
        return cls(along, turned, (across[0], across[1]), points_px, bins, shifts, (factors[0], factors[1]), nominal)

    def windows(self) -> tuple[Window, Window]:
        """The part of each picture that the rim can lie in."""
        result = []
        for points, shifts, factor in zip(self.points_px, self.shifts_px, self.factors, strict=True):
            flat, moves = points.reshape(-1, 2), shifts.reshape(-1, 2)
            corners = np.stack([flat.min(axis=0) + moves.min(axis=0), flat.max(axis=0) + moves.max(axis=0)])
            result.append(Window.around(corners, (MARGIN_PX + 1) * factor, factor))
        return result[0], result[1]

    def pose(self, depth: int, turn: int, row: int, column: int) -> Pose:
        """`pose_camera_hole` of a place on the grid."""
        at = [self.across_m[0][column], self.across_m[1][row], self.along_m[depth]]
        return self.nominal @ Pose.from_rotvec([0, 0, self.turns_rad[turn]], at)


def best_starts(levels: tuple[Level, Level], grid: SearchGrid, count: int) -> list[Pose]:
    """The poses of the grid with the best support in both pictures, apart from each other, best first."""
    score = sum(_scores(levels[side], grid, side) for side in range(2))
    assert isinstance(score, np.ndarray)
    flat = score.ravel()
    pool = np.argpartition(flat, -min(POOL, flat.size))[-POOL:]
    places = np.array(np.unravel_index(pool[np.argsort(flat[pool])[::-1]], score.shape)).T
    chosen: list[NDArray[np.int64]] = []
    for place in places:
        if all(np.any(np.abs(place - other) > APART) for other in chosen):
            chosen.append(place)
            if len(chosen) == count:
                break
    return [grid.pose(*(int(index) for index in place)) for place in chosen]


def oriented(level: Level) -> Floats:
    """(BINS, height, width): edge strength, 0 to 1, with the normal in each bin's direction, either sign."""
    gx, gy = level.gradient[..., 0], level.gradient[..., 1]
    size = np.sqrt(gx * gx + gy * gy) + np.float32(1e-6)
    double_cos, double_sin = (gx * gx - gy * gy) / size, 2.0 * gx * gy / size
    result = np.empty((BINS, *gx.shape), dtype=np.float32)
    spread = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    for index in range(BINS):
        angle = 2.0 * index * np.pi / BINS
        energy = np.maximum(double_cos * np.float32(np.cos(angle)) + double_sin * np.float32(np.sin(angle)), 0.0)
        around = cv2.blur(energy, (AROUND_PX, AROUND_PX))
        share = energy / (energy + NOISE_SHARE * level.noise + AROUND_SHARE * around)
        result[index] = cv2.dilate(share, spread)
    return result


def _scores(level: Level, grid: SearchGrid, side: int) -> Floats:
    """(D, T, G, G): the mean edge strength along the rim in one picture."""
    maps = oriented(level)
    points = np.rint(level.to_level(grid.points_px[side])).astype(int)
    shifts = np.rint(grid.shifts_px[side] / level.factor).astype(int)
    low, high = shifts.reshape(-1, 2).min(axis=0), shifts.reshape(-1, 2).max(axis=0)
    width, height = high - low + 1
    depths, turns, count = points.shape[:3]
    result = np.empty((depths, turns, *shifts.shape[1:3]), dtype=np.float32)
    total = np.empty((height, width), dtype=np.float32)
    starts = points + low
    for depth in range(depths):
        look_up = shifts[depth] - low
        for turn in range(turns):
            total[:] = 0.0
            places = zip(grid.bins[side, depth, turn].tolist(), starts[depth, turn].tolist(), strict=True)
            for bin_, (x, y) in places:
                total += maps[bin_, y : y + height, x : x + width]
            result[depth, turn] = total[look_up[..., 1], look_up[..., 0]]
    return np.asarray(result / count, dtype=np.float32)


def _on_axes(half_ranges: Array) -> Array:
    """(6, 3): the points -x, x, -y, y, -z, z at the half ranges, m."""
    return np.asarray(np.kron(np.diag(half_ranges[:3]), np.array([[-1.0], [1.0]])))


def _steps(travel_px: float) -> int:
    return int(np.clip(np.ceil(travel_px / STEP_PX), 1, MAX_STEPS))


def _grid(half: float, count: int) -> Array:
    """`count` values from -half to half: the middles of equal intervals."""
    return np.asarray(half * ((2.0 * np.arange(count) + 1.0) / count - 1.0))
