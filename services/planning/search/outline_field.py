"""How far a point lies inside an outline: tabulated once, for it is asked a million times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from crosspih_common.geometry.pose import Array


def inside_m(corners_m: Array, points_m: Array) -> Array:
    """The signed distance (n,) of points (n, 2) to an outline with corners (m, 2), m: positive inside."""
    start = np.asarray(corners_m, float)[:, :2]
    points = np.asarray(points_m, float)
    nearest = np.full(len(points), np.inf)
    crossings = np.zeros(len(points), dtype=int)
    for (x, y), (x_end, y_end) in zip(start, np.roll(start, -1, axis=0), strict=True):
        dx, dy = x_end - x, y_end - y
        px, py = points[:, 0] - x, points[:, 1] - y
        share = np.clip((px * dx + py * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(px - share * dx, py - share * dy))
        if dy != 0.0:
            # the very numbers are compared, so that a shared corner counts once
            crossings += ((points[:, 1] >= y) != (points[:, 1] >= y_end)) & (px < dx * py / dy)
    return np.asarray(np.where(crossings % 2 == 1, nearest, -nearest))


@dataclass(frozen=True, slots=True, eq=False)
class OutlineField:
    """The signed distance to an outline on a square grid about its origin: `table_m` (n, n), indexed [x, y]."""

    table_m: Array
    half_size_m: float
    step_m: float

    @classmethod
    def of(cls, corners_m: Array, margin_m: float, step_m: float = 2.5e-4) -> OutlineField:
        """Of an outline (m, 2); beyond `margin_m` outside its farthest corner the edge of the table is repeated."""
        corners = np.asarray(corners_m, float)[:, :2]
        half = float(np.linalg.norm(corners, axis=1).max()) + margin_m
        count = 2 * int(np.ceil(half / step_m)) + 1
        axis = (np.arange(count) - count // 2) * step_m
        grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
        return cls(inside_m(corners, grid).reshape(count, count), (count // 2) * step_m, step_m)

    def inside_m(self, points_m: Array) -> Array:
        """The signed distance of points (..., 2), m, positive inside; bilinear between the grid's."""
        points = np.asarray(points_m, float)
        at = (points.reshape(-1, 2).T + self.half_size_m) / self.step_m
        found = map_coordinates(self.table_m, at, order=1, mode="nearest")
        return np.asarray(found.reshape(points.shape[:-1]))

    def eroded(self, section_m: Array, half_size_m: float, step_m: float) -> OutlineField:
        """How deep a whole section, its points (n, 2) moved by an offset, lies inside: a field over the offset.

        To the nearest place of this grid, so exact to half its step.
        """
        count = 2 * int(np.ceil(half_size_m / step_m)) + 1
        offsets = (np.arange(count) - count // 2) * step_m
        last = len(self.table_m) - 1
        lowest = np.full((count, count), np.inf)
        for x, y in np.asarray(section_m, float)[:, :2]:
            rows, columns = (
                np.clip(np.rint((offsets + here + self.half_size_m) / self.step_m).astype(int), 0, last)
                for here in (x, y)
            )
            np.minimum(lowest, self.table_m[np.ix_(rows, columns)], out=lowest)
        return OutlineField(lowest, (count // 2) * step_m, step_m)
