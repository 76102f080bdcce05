"""The cameras of the pictures: lens, distortion and how two of them stand, in the form of the calibration's file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosspih_common.config import CameraSection
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array


@dataclass(frozen=True, slots=True)
class PictureLens:
    """One camera: u = fx x' + cx, v = fy y' + cy, integers at pixel centres, x' and y' distorted as OpenCV does it.

    `distortion` is none, (k1, k2, p1, p2[, k3[, k4, k5, k6]]) for `plumb_bob`, (k1, k2, k3, k4) for `fisheye`.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion_model: str = "none"
    distortion: tuple[float, ...] = ()

    def distorted(self, xy: Array) -> Array:
        """Normalised image places (..., 2) as the lens bends them, from those of a pinhole."""
        x, y = xy[..., 0], xy[..., 1]
        if self.distortion_model == "none":
            return xy
        r2 = x * x + y * y
        if self.distortion_model == "fisheye":
            r = np.sqrt(np.maximum(r2, 1e-18))
            angle = np.arctan(r)
            a2 = angle * angle
            k1, k2, k3, k4 = self.distortion
            bent = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
            return np.asarray(xy * (bent / r)[..., None])
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.distortion, *(0.0,) * (8 - len(self.distortion)))
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        return np.stack(
            [
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )

    def undistorted(self, xy: Array) -> Array:
        """The inverse of `distorted`, by Newton's steps on the radius and a fixed point for what is not radial."""
        if self.distortion_model == "none":
            return xy
        guess = np.array(xy, dtype=float)
        for _ in range(60):
            bent = self.distorted(guess)
            step = xy - bent
            # the radial scale's slope keeps the step stable where the lens bends much
            guess = guess + 0.8 * step
            if float(np.max(np.abs(step))) < 1e-9:
                break
        return guess

    def project(self, points_m: Array) -> Array:
        """Pixels (..., 2) of points (..., 3) in this camera's frame, m."""
        bent = self.distorted(points_m[..., :2] / points_m[..., 2:3])
        return bent * [self.fx_px, self.fy_px] + [self.cx_px, self.cy_px]

    def said(self, gamma: str, distortion: bool = True) -> dict[str, Any]:
        """What the calibration's file says of it, its distortion told or kept back."""
        told = distortion and self.distortion_model != "none"
        return {
            "width_px": self.width_px, "height_px": self.height_px, "fx_px": self.fx_px, "fy_px": self.fy_px,
            "cx_px": self.cx_px, "cy_px": self.cy_px, "distortion_model": self.distortion_model if told else "none",
            "distortion": list(self.distortion) if told else [], "gamma": gamma,
        }  # fmt: skip

    def scaled(self, factor: float, size_px: tuple[int, int]) -> PictureLens:
        """The same lens before a sensor with other pixels, the axis at the same share of the picture."""
        share_x, share_y = (self.cx_px + 0.5) / self.width_px, (self.cy_px + 0.5) / self.height_px
        width, height = size_px
        return replace(
            self, width_px=width, height_px=height, fx_px=self.fx_px * factor, fy_px=self.fy_px * factor,
            cx_px=share_x * width - 0.5, cy_px=share_y * height - 0.5,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """Two cameras; the right one's pose in the left one's frame, the left one's in the base frame."""

    left: PictureLens
    right: PictureLens
    pose_left_right: Pose
    pose_base_camera: Pose

    @property
    def lenses(self) -> tuple[PictureLens, PictureLens]:
        """Left and right."""
        return self.left, self.right

    def project(self, points_camera_m: Array) -> NDArray[np.float64]:
        """Pixels (2, ..., 2), left then right, of points (..., 3) in the left camera's frame."""
        points = np.asarray(points_camera_m, dtype=float)
        return np.stack([self.left.project(points), self.right.project(self.pose_left_right.inverse().apply(points))])

    def said(self, gamma: str = "linear", distortion: bool = True) -> dict[str, Any]:
        """The calibration's file as a dict: what the message `camera/calibration` says."""
        return {
            "left": self.left.said(gamma, distortion),
            "right": self.right.said(gamma, distortion),
            "pose_left_right": _pose_said(self.pose_left_right),
            "pose_base_camera": _pose_said(self.pose_base_camera),
        }


def _pose_said(pose: Pose) -> dict[str, list[float]]:
    return {
        "position_m": [float(value) for value in pose.translation_m],
        "quaternion_xyzw": [float(value) for value in pose.quaternion_xyzw()],
    }


def cell_pair(camera: CameraSection | None = None) -> Pair:
    """The pair of a cell's file; the default cell's when none is given."""
    section = camera or CameraSection()
    lens = PictureLens(section.width_px, section.height_px, section.fx_px, section.fy_px, section.cx_px, section.cy_px)
    return Pair(lens, lens, Pose.from_translation([section.baseline_m, 0.0, 0.0]), section.pose_base_camera())


def resized(pair: Pair, factor: float, size_px: tuple[int, int]) -> Pair:
    """The pair with other sensors behind the same lenses."""
    return replace(pair, left=pair.left.scaled(factor, size_px), right=pair.right.scaled(factor, size_px))


def bent(pair: Pair, model: str, left: Sequence[float], right: Sequence[float] | None = None) -> Pair:
    """The pair with lenses that distort."""
    one, other = (tuple(map(float, values)) for values in (left, left if right is None else right))
    return replace(
        pair,
        left=replace(pair.left, distortion_model=model, distortion=one),
        right=replace(pair.right, distortion_model=model, distortion=other),
    )


def toed_in(pair: Pair, rng: np.random.Generator) -> Pair:
    """The pair as it would be bolted together: the right camera turned inwards, a little aside and not quite equal."""
    turn = [rng.normal(0.0, 0.01), -rng.uniform(0.03, 0.12), rng.normal(0.0, 0.01)]
    shift = pair.pose_left_right.translation_m + rng.normal(0.0, 0.0015, 3)
    right = replace(
        pair.right, fx_px=pair.right.fx_px * rng.uniform(0.97, 1.03), fy_px=pair.right.fy_px * rng.uniform(0.97, 1.03),
        cx_px=pair.right.cx_px + rng.uniform(-6.0, 6.0), cy_px=pair.right.cy_px + rng.uniform(-6.0, 6.0),
    )  # fmt: skip
    return replace(pair, right=right, pose_left_right=Pose.from_rotvec(turn, shift))
