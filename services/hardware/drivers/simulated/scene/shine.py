"""The light that comes back from a plate as from metal: by where the lamp and each camera stand.

A face with grooves mirrors narrowly along them and widely across (Ward 1992); a broken edge mirrors as a thin cylinder
does, where the half way between lamp and eye is square to it (Kajiya and Kay 1989). All in the hole frame {D}.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole
from services.hardware.drivers.simulated.scene.finish import (
    SIZE,
    Marks,
    lay_rad,
    marks,
    places_m,
    texel_m,
    texels,
)
from services.hardware.drivers.simulated.scene.scene_appearance import Appearance

COARSE = 33
# how far a face scatters what it mirrors, tangents: all ways; along grooves and across them
ALL_WAYS, ALONG, ACROSS = 0.45, 0.35, 0.8
METAL_SHARE, MAX_GAIN = 0.65, 2.5
EDGE_SPREAD, EDGE_STEP_M, EDGE_TEXELS = 0.12, 1e-3, 2
# a broken edge has every normal between the face's and the chamfer's, and a little more, rad
EDGE_FIRST, EDGE_LAST, EDGE_SOFT = 0.0, np.pi / 4, 0.12
STRETCHES, STRETCH_M = (1, 6), (0.004, 0.025)
SPOT_RADII_M, SPOT_GREYS, SPOT_OTHER = (0.3e-3, 1.2e-3), (30.0, 110.0), (0.3, 1.0)
BITS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Lit:
    """What one camera sees of a plate, beyond the even grey that the renderer draws.

    face (SIZE, SIZE, 2): a factor, and grey levels added, of each texel of the face; added also holds for the chamfer
    under it. chamfer: a factor for each way that the chamfer faces.
    """

    face: NDArray[np.float32]
    chamfer: tuple[float, ...]


class Plate:
    """One plate under one light: marks made once, shine by the camera."""

    def __init__(self, hole: Hole, look: Appearance, ways: list[Array]) -> None:
        self._hole, self._look, self._ways = hole, look, ways
        half = hole.plate_half_size_m
        x, y = places_m(half, COARSE)
        self._points = np.stack([x, y, np.zeros_like(x)], axis=-1)
        self._lay = lay_rad(look.finish, x, y, look.marks_seed)
        across, down = look.face_gradient
        gradient = 1.0 + 0.5 * (across * x + down * y) / half
        self._even: Marks = np.asarray(
            (1.0 + look.finish_strength * marks(look.finish, half, look.marks_seed)) * _fine(gradient), np.float32
        )
        self._edges = _Edges.of(hole, look) if look.edge_glints > 0.0 else None
        self._spots = _spots(look, half)

    def lit(self, pose_base_hole: Pose, poses_base_camera: tuple[Pose, Pose], to_light: Array) -> tuple[Lit, Lit]:
        """As the left and the right camera see it; `to_light` (3,) in the base frame."""
        into_hole = pose_base_hole.inverse()
        light = into_hole.rotate(to_light)
        eyes_m = [into_hole.apply(pose.translation_m) for pose in poses_base_camera]
        shines = [self._shine(self._points, light, eye_m) for eye_m in eyes_m]
        # the exposure is set to what both see on the whole
        level = max(float(np.mean(shines)), 1e-9)
        return (
            self._lit(shines[0] / level, level, light, eyes_m[0], 0),
            self._lit(shines[1] / level, level, light, eyes_m[1], 1),
        )

    def _lit(self, shine: Array, level: float, light: Array, eye_m: Array, side: int) -> Lit:
        metal = METAL_SHARE * self._look.shine
        factor = self._even * _fine(np.minimum(1.0 - metal + metal * shine, MAX_GAIN))
        added = np.zeros((SIZE, SIZE), dtype=np.float32)
        if self._edges is not None:
            added += self._edges.seen(light, eye_m)
        for row, column, spot in self._spots[side]:
            part = added[row : row + spot.shape[0], column : column + spot.shape[1]]
            part += spot[: part.shape[0], : part.shape[1]]
        spread = self._look.chamfer_spread
        chamfer = []
        for normal in self._ways:
            half_way = _half_way(np.zeros(3), light, eye_m)
            up = max(float(half_way @ normal), 1e-3)
            mirrored = np.exp(-0.5 * (1.0 / up**2 - 1.0) / spread**2) / spread**2 / level
            chamfer.append(float(min(1.0 - metal + metal * mirrored, MAX_GAIN)))
        return Lit(np.stack([factor, added], axis=-1), tuple(chamfer))

    def _shine(self, points_m: Array, light: Array, eye_m: Array) -> Array:
        half_way = _half_way(points_m, light, eye_m)
        x, y, up = half_way[..., 0], half_way[..., 1], np.maximum(-half_way[..., 2], 1e-3)
        if self._lay is None:
            return np.asarray(np.exp(-0.5 * (x * x + y * y) / (up * ALL_WAYS) ** 2) / ALL_WAYS**2)
        c, s = np.cos(self._lay), np.sin(self._lay)
        along, across = (x * c + y * s) / up, (y * c - x * s) / up
        return np.asarray(np.exp(-0.5 * ((along / ALONG) ** 2 + (across / ACROSS) ** 2)) / (ALONG * ACROSS))


class _Edges:
    """The broken outer edge of the rim in short pieces, some of them bright."""

    def __init__(self, ends_m: Array, inwards: Array, greys: Array, half_size_m: float) -> None:
        self._ends_m, self._inwards, self._greys, self._half = ends_m, inwards, greys, half_size_m

    @classmethod
    def of(cls, hole: Hole, look: Appearance) -> _Edges:
        """Pieces of about 1 mm; their greys by the seed."""
        # lamps stand in other places: what they make bright is elsewhere
        rng = np.random.default_rng([look.marks_seed, 1, look.lamp])
        rim = hole.outer_rim_m()[:, :2]
        inset = 0.5 * EDGE_TEXELS * texel_m(hole.plate_half_size_m)
        ends, inwards = [], []
        for start, end, outward in zip(rim, np.roll(rim, -1, axis=0), hole.outline.normals, strict=True):
            count = max(1, round(float(np.linalg.norm(end - start)) / EDGE_STEP_M))
            share = np.linspace(0.0, 1.0, count + 1)[:, None]
            line = start + share * (end - start) - inset * outward
            ends.append(np.stack([line[:-1], line[1:]], axis=1))
            inwards.append(np.tile(-outward, (count, 1)))
        pieces = np.concatenate(ends)
        lengths = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1)
        place_m = np.cumsum(lengths) - 0.5 * lengths
        around_m = float(lengths.sum())
        greys = np.zeros(len(pieces))
        for _ in range(int(rng.integers(STRETCHES[0], STRETCHES[1] + 1))):
            middle_m, half_m = rng.uniform(0.0, around_m), 0.5 * rng.uniform(*STRETCH_M)
            off = np.abs((place_m - middle_m + 0.5 * around_m) % around_m - 0.5 * around_m)
            bright = look.edge_glints * rng.uniform(0.5, 1.0) * np.clip(2.0 - 2.0 * off / half_m, 0.0, 1.0)
            greys = np.maximum(greys, bright)
        bright_ones = greys > 1.0
        return cls(
            pieces[bright_ones], np.concatenate(inwards)[bright_ones], greys[bright_ones], hole.plate_half_size_m
        )

    def seen(self, light: Array, eye_m: Array) -> Marks:
        """Grey levels added to each texel (SIZE, SIZE)."""
        middles = self._ends_m.mean(axis=1)
        half_way = _half_way(np.column_stack([middles, np.zeros(len(middles))]), light, eye_m)
        along = self._ends_m[:, 1] - self._ends_m[:, 0]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        off_square = np.sum(half_way[:, :2] * along, axis=1)
        lean = np.arctan2(np.sum(half_way[:, :2] * self._inwards, axis=1), -half_way[:, 2])
        outside = np.maximum(0.0, np.maximum(EDGE_FIRST - lean, lean - EDGE_LAST))
        greys = self._greys * np.exp(-0.5 * (off_square / EDGE_SPREAD) ** 2 - 0.5 * (outside / EDGE_SOFT) ** 2)
        drawn = np.zeros((SIZE, SIZE), dtype=np.uint8)
        at = np.rint(texels(self._ends_m, self._half) * 2**BITS).astype(int)
        for (start, end), grey in zip(at.tolist(), np.minimum(greys, 255.0).tolist(), strict=True):
            if grey >= 1.0:
                cv2.line(drawn, start, end, grey, EDGE_TEXELS, cv2.LINE_AA, BITS)
        return drawn.astype(np.float32)


def _half_way(points_m: Array, light: Array, eye_m: Array) -> Array:
    """The unit vectors half way between the directions to the light and to the eye."""
    to_eye = eye_m - points_m
    to_eye = to_eye / np.linalg.norm(to_eye, axis=-1, keepdims=True)
    middle = to_eye + light
    return np.asarray(middle / np.linalg.norm(middle, axis=-1, keepdims=True))


def _spots(look: Appearance, half_size_m: float) -> tuple[list[tuple[int, int, Marks]], list[tuple[int, int, Marks]]]:
    """Bright spots as the left and as the right camera sees them: first row, first column, grey levels."""
    rng = np.random.default_rng([look.marks_seed, 2, look.lamp])
    sides: tuple[list[tuple[int, int, Marks]], list[tuple[int, int, Marks]]] = [], []
    for _ in range(look.face_glints):
        at = texels(rng.uniform(-1.0, 1.0, 2) * half_size_m, half_size_m)
        radius = rng.uniform(*SPOT_RADII_M) / texel_m(half_size_m)
        grey, less, fainter = rng.uniform(*SPOT_GREYS), rng.uniform(*SPOT_OTHER), int(rng.integers(2))
        reach = int(np.ceil(3.0 * radius))
        left, top = np.maximum(np.rint(at).astype(int) - reach, 0).tolist()
        rows, columns = np.arange(top, top + 2 * reach + 1), np.arange(left, left + 2 * reach + 1)
        fade = np.exp(-0.5 * ((rows[:, None] - at[1]) ** 2 + (columns[None, :] - at[0]) ** 2) / radius**2)
        for side in range(2):
            level = grey * (less if side == fainter else 1.0)
            sides[side].append((top, left, np.asarray(level * fade, dtype=np.float32)))
    return sides


def _fine(coarse: Array) -> Marks:
    """A smooth thing on (COARSE, COARSE) parts of the face, on its texels."""
    size = (SIZE, SIZE)
    return np.asarray(cv2.resize(coarse.astype(np.float32), size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)
