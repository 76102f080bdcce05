"""Tests whether straight edges are straight through the calibrated lens; the remaining bow is expressed as a k1.

A wrong or missing distortion moves the rim by less than a stereo pair shows and still spoils the pose. Long edges of
the plate or of nearby objects bow by it (the plumb-line method, Brown 1971). Edges of real objects are not straight to
a hundredth of a pixel, so each is given a bow of its own, and no single edge decides.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from services.vision.light import Light, shown
from services.vision.stereo import Camera

SEARCH_WIDTH_PX = 400  # lines are looked for in a picture no wider than this
MIN_LENGTH = 0.1  # length of a line, as a share of the picture's width
MAX_EDGES, MIN_EDGES, EDGES_SURE = 24, 3, 4
ENDS = 0.06  # share of a line at each end that a corner disturbs
ALONG = 96  # profiles across a line
REACH_PX, STEP_PX = 6.0, 0.5
MIN_STEP_NOISE = 4.0  # of the step at an edge, in sd of the profile about it
MAX_ROUGH_PX = 0.5
# sd of the sagitta of a real straight edge, as an angle: 0.05 mm at 0.3 m; and factor on its raggedness: an edge that
# is ragged in the small is not straight in the large
OWN_BOW_RAD, RAGGED_BOW = 1.6e-4, 1.5
MAX_ALIKE = 0.8
DEGREES = 4.0  # of Student's t: a single edge of a curved object counts little
JOIN_STEPS = 8
SURE, SURE_WITHOUT_ONE = 4.0, 2.5
MIN_K1 = 0.005
MAX_K1 = 0.5  # an edge that bows by more belongs to no straight object: a round plate's, a cable's
HIGHER_SHARE = 0.1  # size of k2 and higher terms as a share of k1; edges near the middle do not show them


@dataclass(frozen=True, slots=True)
class LeftOver:
    """The k1 that would make the edges straight, its sd, the number of edges, and whether they are conclusive."""

    k1: float
    sd: float
    edges: int
    sure: bool


@dataclass(frozen=True, slots=True)
class Lenses:
    """The results of straight edges for the left lens, the right one, and both as two lenses of one type."""

    left: LeftOver | None
    right: LeftOver | None
    both: LeftOver | None

    @property
    def sure(self) -> bool:
        """Whether the bow of the edges is beyond chance."""
        return any(one is not None and one.sure for one in (self.left, self.right, self.both))

    def by_side(self) -> tuple[Array, Array]:
        """k1 (2,) of the left and the right lens, and its sd (2,). A lens with too few edges is assumed to be like the
        other; without any edges, 0 and infinity."""
        found = [one or self.both for one in (self.left, self.right)]
        twice = np.sqrt(2.0) if self.left is None and self.right is None else 1.0
        return (
            np.array([0.0 if one is None else one.k1 for one in found]),
            np.array([np.inf if one is None else np.hypot(twice * one.sd, HIGHER_SHARE * one.k1) for one in found]),
        )

    def figures(self) -> dict[str, float]:
        """The remaining k1 of each lens by name, where enough edges are seen; `bow_sure` is 1 where it is beyond
        chance."""
        told: dict[str, float] = {}
        for name, one in (("_left", self.left), ("_right", self.right), ("", self.both)):
            if one is not None:
                told |= {f"bow_k1{name}": one.k1, f"bow_k1_sd{name}": one.sd, f"bow_sure{name}": float(one.sure)}
        return told

    def warnings(self) -> tuple[str, ...]:
        """Warnings for the user; none where the lenses agree with their calibration as far as the edges show."""
        sure = [(side, one) for side, one in (("left", self.left), ("right", self.right)) if one and one.sure]
        if len(sure) != 1 and self.both is not None and self.both.sure:
            sure = [("left and the right", self.both)]
        return tuple(
            f"the {side} camera's lens is not as calibrated: straight edges bow by a k1 of {one.k1:.3f} (one sd "
            f"{one.sd:.3f}); the pose given allows for it; calibrate the distortion anew"
            for side, one in sure
        )


def lenses_of(images: tuple[Light, Light], cameras: tuple[Camera, Camera]) -> Lenses:
    """From the left and the right picture (height, width), linear light."""
    left, right = (bows(light, camera) for light, camera in zip(images, cameras, strict=True))
    return Lenses(left_over(left), left_over(right), left_over(np.concatenate([left, right])))


def bows(light: Light, camera: Camera) -> Array:
    """(n, 2): the k1 and its sd from each long edge in a picture (height, width)."""
    edges = _edges(light, _lines(light, camera))
    found = [bow for points in edges if (bow := _of_edge(points, camera)) is not None]
    k1, sd = np.array(found).reshape(-1, 2).T
    straight = np.abs(k1) < MAX_K1
    return np.stack([k1[straight], sd[straight]], axis=1)


def left_over(seen: Array) -> LeftOver | None:
    """The result of edges (n, 2), as `bows` gives them, for one lens, or for two alike; None where they are too few."""
    if len(seen) < MIN_EDGES:
        return None
    values, sds = seen.T

    def joined(some: NDArray[np.signedinteger]) -> tuple[float, float]:
        known = sds[some] ** -2
        weight, k1 = known, 0.0
        for _ in range(JOIN_STEPS):
            k1 = float(weight @ values[some] / weight.sum())
            weight = known * np.minimum((DEGREES + 1.0) / (DEGREES + known * (values[some] - k1) ** 2), 1.0)
        spread = float(np.sum(weight * (values[some] - k1) ** 2)) / max(len(weight) - 1, 1)
        return k1, float(weight.sum() ** -0.5 * max(1.0, spread) ** 0.5)

    everything = np.arange(len(values))
    k1, sd = joined(everything)
    without = [joined(np.delete(everything, one)) for one in everything]
    enough = len(values) >= EDGES_SURE and abs(k1) > max(SURE * sd, MIN_K1)
    sure = enough and all(
        np.sign(one) == np.sign(k1) and abs(one) > SURE_WITHOUT_ONE * its_sd for one, its_sd in without
    )
    return LeftOver(k1, sd, len(values), sure)


def _lines(light: Light, camera: Camera) -> Array:
    """(n, 2, 2): ends of the longest lines, px, at most one line per edge."""
    scale = max(1.0, light.shape[1] / SEARCH_WIDTH_PX)
    size = round(light.shape[1] / scale), round(light.shape[0] / scale)
    small = light if scale == 1.0 else cv2.resize(light, size, interpolation=cv2.INTER_AREA)
    grey = shown(np.asarray(small * (255.0 / max(float(small.max()), 1.0)), np.float32), camera.gamma)
    detected: Any = cv2.createLineSegmentDetector().detect(grey)[0]
    if detected is None:
        return np.zeros((0, 2, 2))
    factor = np.array([light.shape[1] / size[0], light.shape[0] / size[1]])
    ends = (np.asarray(detected, dtype=float).reshape(-1, 2, 2) + 0.5) * factor - 0.5
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    kept: list[Array] = []
    for index in np.argsort(-length):
        if length[index] < MIN_LENGTH * light.shape[1] or len(kept) == MAX_EDGES:
            break
        if not any(_same(ends[index], other) for other in kept):
            kept.append(ends[index])
    return np.array(kept).reshape(-1, 2, 2)


def _same(line: Array, other: Array) -> bool:
    """Whether the middle of a line lies on another one, with the same direction."""
    along = other[1] - other[0]
    length = float(np.linalg.norm(along))
    along = along / length
    off = line.mean(axis=0) - other[0]
    beside = abs(float(off[0] * along[1] - off[1] * along[0]))
    way = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
    return beside < REACH_PX and -REACH_PX < float(off @ along) < length + REACH_PX and abs(float(way @ along)) > 0.98


def _of_edge(points: Array, camera: Camera) -> tuple[float, float] | None:
    """k1 and its sd by points (ALONG, 2), px, along one edge; None where they are too ragged to tell."""
    focal = np.array([camera.fx_px, camera.fy_px])
    slopes = camera.slopes(points)
    if not np.isfinite(slopes).all():
        return None
    ideal = slopes * focal
    middle = ideal.mean(axis=0)
    _, _, axes = np.linalg.svd(ideal - middle, full_matrices=False)
    s, off = (ideal - middle) @ axes[0], (ideal - middle) @ axes[1]
    half = 0.5 * float(np.ptp(s))
    straight = np.stack([np.ones_like(s), s / half], axis=1)

    def without_line(values: Array) -> Array:
        return np.asarray(values - straight @ np.linalg.lstsq(straight, values, rcond=None)[0])

    bowed = without_line((slopes * np.sum(slopes**2, axis=1, keepdims=True) * focal) @ axes[1])
    own, off = without_line((s / half) ** 2), without_line(off)
    shape = np.stack([own, without_line((s / half) ** 3)], axis=1)
    rest = off - shape @ np.linalg.lstsq(shape, off, rcond=None)[0]
    rough = float(np.std(rest))
    strength = float(bowed @ bowed)
    if rough > MAX_ROUGH_PX or strength < 1e-9:
        return None
    # neighbours with the same error are not independent
    alike = float(np.clip(rest[1:] @ rest[:-1] / max(float(rest @ rest), 1e-12), 0.0, MAX_ALIKE))
    ragged = rough * float(np.sqrt((1.0 + alike) / (1.0 - alike) / strength))
    own_bow_px = np.hypot(OWN_BOW_RAD * np.sqrt(camera.fx_px * camera.fy_px), RAGGED_BOW * rough)
    return float(bowed @ off / strength), float(np.hypot(ragged, own_bow_px * (bowed @ own) / strength))


def _edges(light: Light, lines: Array) -> list[Array]:
    """For lines (n, 2, 2), px, the ones along a clear single edge: its points (ALONG, 2), px; each profile across the
    edge is shifted until it matches the mean of all."""
    along = lines[:, 1] - lines[:, 0]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    at = lines[:, :1] + np.linspace(ENDS, 1.0 - ENDS, ALONG)[:, None] * along[:, None]
    offsets = np.arange(-REACH_PX, REACH_PX + 1e-9, STEP_PX)
    reach = at[:, [0, 0, -1, -1]] + REACH_PX * normal[:, None] * np.array([[-1], [1], [-1], [1]])
    low, high = reach.min(axis=(1, 2)), np.array(light.shape[::-1]) - 2.0 - reach.max(axis=1)
    inside = (low >= 1.0) & (high >= 0.0).all(axis=1)
    at, normal = at[inside], normal[inside]
    if not len(at):
        return []
    clear, shift = np.ones(len(at), dtype=bool), np.zeros(at.shape[:2])
    for _ in range(4):
        places = at[:, :, None] + (offsets[:, None] + shift[..., None, None]) * normal[:, None, None]
        rows = places.reshape(-1, len(offsets), 2).astype(np.float32)
        seen = cv2.remap(light, rows[..., 0], rows[..., 1], cv2.INTER_CUBIC)
        grey = np.asarray(seen, dtype=float).reshape(*at.shape[:2], -1)
        mean = grey.mean(axis=1)
        slope = np.gradient(mean, STEP_PX, axis=1)
        basis = np.stack([np.ones_like(mean), mean - mean.mean(axis=1, keepdims=True), slope], axis=2)
        parts = np.linalg.pinv(basis) @ np.swapaxes(grey, 1, 2)
        gain = parts[:, 1]
        clear &= np.median(gain, axis=1) >= 0.5
        step = np.clip(parts[:, 2] / np.where(np.abs(gain) > 0.2, gain, np.inf), -1.0, 1.0)
        shift = shift - step
        shift -= shift.mean(axis=1, keepdims=True)
    noise = np.std(grey - np.swapaxes(basis @ parts, 1, 2), axis=(1, 2))
    height = np.abs(mean[:, -1] - mean[:, 0])
    single = np.abs(np.diff(mean, axis=1)).sum(axis=1) < 1.3 * height
    clear &= single & (height >= MIN_STEP_NOISE * noise) & (np.abs(shift).max(axis=1) <= REACH_PX / 2)
    return list((at + shift[..., None] * normal[:, None])[clear])
