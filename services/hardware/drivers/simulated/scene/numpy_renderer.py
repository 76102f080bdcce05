"""Pictures in NumPy, for a machine without PyBullet: every triangle's rows as spans, a depth for each of their samples,
and a colour for those that are nearest. No shadows and no highlights.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.scene.renderer import Drawn, Rgb, View
from services.hardware.drivers.simulated.scene.scene_mesh import RenderMesh

_CHUNK = 4_000_000


@dataclass(slots=True, eq=False)
class _Body:
    corners_m: Array  # (k, 3, 3) of each triangle
    normals: Array  # (k, 3, 3) at each corner
    pose: Pose
    rgb: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Triangles:
    """k triangles in front of the near plane and turned to the camera."""

    pixels: Array  # (k, 3, 2): x to the right and y down, in samples
    inverse_w: Array  # (k, 3): one over the distance along the camera's axis, linear in the picture
    normals: Array  # (k, 3, 3), base frame
    rgb: Array  # (k, 3)
    body: NDArray[np.intp]  # (k,): whose they are


class NumpyRenderer:
    """Implements the Renderer protocol."""

    def __init__(self) -> None:
        self._bodies: list[_Body] = []

    def close(self) -> None:
        """Let the meshes go."""
        self._bodies.clear()

    def add(self, mesh: RenderMesh) -> int:
        """A new body; its number."""
        indices = np.asarray(mesh.indices, dtype=int).reshape(-1, 3)
        self._bodies.append(_Body(mesh.vertices_m[indices], mesh.normals[indices], Pose.identity(), np.ones(3)))
        return len(self._bodies) - 1

    def place(self, body: int, pose_base_body: Pose) -> None:
        """Put a body somewhere."""
        self._bodies[body].pose = pose_base_body

    def colour(self, body: int, rgb: Rgb) -> None:
        """Paint a body, 0 to 1 a channel."""
        self._bodies[body].rgb = np.array(rgb)

    def draw(self, view: View) -> Drawn:
        """A picture."""
        triangles = self._projected(view)
        nearest = np.zeros(view.width * view.height)
        owner = np.full(view.width * view.height, -1)
        for chosen, at, inverse_w in _samples(triangles, view.width, view.height):
            np.maximum.at(nearest, at, inverse_w)
            on_top = inverse_w == nearest[at]
            owner[at[on_top]] = chosen[on_top]
        rgb = np.zeros((view.width * view.height, 3), dtype=np.uint8)
        seen = np.flatnonzero(owner >= 0)
        rgb[seen] = _shaded(triangles, owner[seen], seen % view.width, seen // view.width, view)
        shape = view.height, view.width
        body = np.full(len(owner), -1, dtype=np.int32)
        body[seen] = triangles.body[owner[seen]]
        return Drawn(rgb.reshape(*shape, 3), body.reshape(shape))

    def _projected(self, view: View) -> _Triangles:
        look = np.reshape(view.view_matrix, (4, 4)).T
        lens = np.reshape(view.projection_matrix, (4, 4)).T
        near_m = lens[2, 3] / (lens[2, 2] - 1.0)
        corners, normals, colours, numbers = [], [], [], []
        for number, body in enumerate(self._bodies):
            placed = look @ body.pose.matrix()
            in_view = body.corners_m @ placed[:3, :3].T + placed[:3, 3]
            turned = body.normals @ body.pose.rotation.T
            in_view, turned = _in_front(in_view, turned, near_m)
            corners.append(in_view)
            normals.append(turned)
            colours.append(np.broadcast_to(body.rgb, (len(in_view), 3)))
            numbers.append(np.full(len(in_view), number))
        points, normal, rgb = np.concatenate(corners), np.concatenate(normals), np.concatenate(colours)
        of_body = np.concatenate(numbers)
        w = -points[..., 2]
        x = (lens[0, 0] * points[..., 0] + lens[0, 2] * points[..., 2]) / w
        y = (lens[1, 1] * points[..., 1] + lens[1, 2] * points[..., 2]) / w
        pixels = np.stack([(x + 1.0) * 0.5 * view.width, (1.0 - y) * 0.5 * view.height], axis=-1)
        # anticlockwise from outside, and y points down
        towards = _doubled_areas(pixels) < -1e-9
        return _Triangles(pixels[towards], 1.0 / w[towards], normal[towards], rgb[towards], of_body[towards])


def _in_front(corners_m: Array, normals: Array, near_m: float) -> tuple[Array, Array]:
    """The parts of triangles (k, 3, 3) in the camera's frame (it looks along -z) that lie beyond the near plane."""
    ahead = -corners_m[..., 2] > near_m
    count = ahead.sum(axis=1)
    whole = count == 3
    if np.all(whole | (count == 0)):
        return corners_m[whole], normals[whole]
    cut_corners, cut_normals = [], []
    for index in np.flatnonzero((count == 1) | (count == 2)):
        ring: list[tuple[Array, Array]] = []
        for here in range(3):
            there = (here + 1) % 3
            a, b = corners_m[index, here], corners_m[index, there]
            m, n = normals[index, here], normals[index, there]
            if ahead[index, here]:
                ring.append((a, m))
            if ahead[index, here] != ahead[index, there]:
                part = (near_m + a[2]) / (a[2] - b[2])
                ring.append((a + part * (b - a), m + part * (n - m)))
        for last in range(2, len(ring)):
            fan = ring[0], ring[last - 1], ring[last]
            cut_corners.append([corner for corner, _ in fan])
            cut_normals.append([normal for _, normal in fan])
    return (
        np.concatenate([corners_m[whole], np.array(cut_corners)]),
        np.concatenate([normals[whole], np.array(cut_normals)]),
    )


def _doubled_areas(pixels: Array) -> Array:
    """Of triangles (k, 3, 2), (k,): negative where the corners go anticlockwise to the eye."""
    one, other = pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]
    return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])


def _samples(
    triangles: _Triangles, width: int, height: int
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp], Array]]:
    """All samples of all triangles in pieces: the triangle, the pixel and one over the distance of each, (s,) each."""
    pixels, inverse_w = triangles.pixels, triangles.inverse_w
    # a pixel's sample is at (column, row + 1)
    top = np.clip(np.ceil(pixels[..., 1].min(axis=1)) - 1.0, 0, height).astype(int)
    bottom = np.clip(np.floor(pixels[..., 1].max(axis=1)), 0, height).astype(int)
    of_row, row = _runs(np.maximum(0, bottom - top), top)
    y = np.asarray(row + 1.0, dtype=float)
    left, right = _span(pixels[of_row], y)
    first = np.clip(np.ceil(left), 0, width).astype(int)
    counts = np.maximum(0, np.clip(np.floor(right) + 1.0, 0, width).astype(int) - first)
    across, down = _slopes(pixels, inverse_w)
    at_left = inverse_w[of_row, 0] + down[of_row] * (y - pixels[of_row, 0, 1])
    at_left -= across[of_row] * pixels[of_row, 0, 0]
    ends = np.cumsum(counts)
    begin = 0
    while begin < len(counts):
        before = ends[begin - 1] if begin else 0
        end = max(begin + 1, int(np.searchsorted(ends, before + _CHUNK)))
        some = slice(begin, end)
        line, column = _runs(counts[some], first[some])
        chosen = of_row[some][line]
        yield chosen, row[some][line] * width + column, at_left[some][line] + across[chosen] * column
        begin = end


def _runs(counts: NDArray[np.intp], starts: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """For counts (k,): which of the k, and start, start + 1, ... of each, one after the other."""
    which = np.repeat(np.arange(len(counts)), counts)
    before = np.cumsum(counts) - counts
    return which, np.arange(len(which)) - before[which] + starts[which]


def _span(corners: Array, y: Array) -> tuple[Array, Array]:
    """Where rows y (r,) enter and leave triangles (r, 3, 2): columns (r,), left of right where they meet."""
    left, right = np.full(len(y), -np.inf), np.full(len(y), np.inf)
    for here, there in ((0, 1), (1, 2), (2, 0)):
        dx, dy = (corners[:, there] - corners[:, here]).T
        height = y - corners[:, here, 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            at = corners[:, here, 0] + dx / dy * height
        left = np.where(dy > 0.0, np.maximum(left, at), left)
        right = np.where(dy < 0.0, np.minimum(right, at), right)
        right = np.where((dy == 0.0) & (dx * height > 0.0), -np.inf, right)
    return left, right


def _slopes(pixels: Array, values: Array) -> tuple[Array, Array]:
    """How values (k, 3) at the corners of triangles (k, 3, 2) change a pixel to the right and one down, (k,) each."""
    one, other = pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]
    rise, more = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    area = _doubled_areas(pixels)
    return (rise * other[:, 1] - more * one[:, 1]) / area, (more * one[:, 0] - rise * other[:, 0]) / area


def _shaded(
    triangles: _Triangles, owner: NDArray[np.intp], column: NDArray[np.intp], row: NDArray[np.intp], view: View
) -> NDArray[np.uint8]:
    """The colours (s, 3) of samples by the triangle that each belongs to."""
    to_light = np.asarray(view.to_light, float) / np.linalg.norm(view.to_light)
    flat = np.all(np.ptp(triangles.normals, axis=1) < 1e-9, axis=1)
    colours = _lit(triangles.normals[:, 0] @ to_light, triangles.rgb, view)[owner]
    round_ones = np.flatnonzero(~flat[owner])
    if len(round_ones):
        own = owner[round_ones]
        pixels, inverse_w, normals = triangles.pixels[own], triangles.inverse_w[own], triangles.normals[own]
        at = np.stack([column[round_ones], row[round_ones] + 1.0], axis=-1)
        area = _doubled_areas(pixels)
        parts = np.stack(
            [
                _doubled_areas(np.stack([at, pixels[:, (k + 1) % 3], pixels[:, (k + 2) % 3]], axis=1)) / area
                for k in range(3)
            ],
            axis=1,
        )
        parts *= inverse_w
        normal = np.einsum("sk,skc->sc", parts, normals)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        colours[round_ones] = _lit(normal @ to_light, triangles.rgb[own], view)
    return colours


def _lit(cosine: Array, rgb: Array, view: View) -> NDArray[np.uint8]:
    light = view.ambient + view.diffuse * np.maximum(0.0, cosine)
    return np.asarray(np.minimum(255.0, np.floor(255.0 * rgb) * light[:, None]), dtype=np.uint8)
