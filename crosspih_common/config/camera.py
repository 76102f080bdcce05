"""The stereo pair of a cell: where it stands, its pinhole numbers and its lenses."""

from __future__ import annotations

import numpy as np
from pydantic import Field, field_validator, model_validator

from crosspih_common.config.section import Section
from crosspih_common.geometry import Pose

MAX_NUMBERS = 8
RADII = 2000


class CameraSection(Section):
    """Two equal parallel cameras, as calibrated, each with a lens of its own; z looks ahead, x right, y down.

    The simulated cameras use these values. A driver that knows its cameras' calibration publishes it on
    `camera/calibration`. Pixel (u, v) = (fx x'/z + cx, fy y'/z + cy), with integers at pixel centres, u to the right
    and v down, and (x', y') after the lens distortion `distortion`, OpenCV's plumb_bob.
    """

    # the paper's Eq. 8, signs restored
    matrix_base_camera: tuple[tuple[float, float, float, float], ...] = Field(
        default=((0.0, 0.0, 1.0, 0.1310), (-1.0, 0.0, 0.0, -0.2406), (0.0, -1.0, 0.0, 0.2225)),
        min_length=3, max_length=3, description="the left camera in the base frame, the upper three rows",
    )  # fmt: skip
    baseline_m: float = Field(default=0.05, gt=0.0, description="of the right camera, along the left one's x")
    width_px: int = Field(default=640, ge=16, le=8192)
    height_px: int = Field(default=480, ge=16, le=8192)
    fx_px: float = Field(default=381.36, gt=0.0)
    fy_px: float = Field(default=381.36, gt=0.0)
    # that of the paper's simulator (hfov 80 degrees): it reproduces the paper's printed x and z
    cx_px: float = 320.5
    cy_px: float = 240.5
    distortion: tuple[float, ...] = Field(
        default=(), description="of the left lens: k1, k2, p1, p2, k3, k4, k5, k6; those left out are 0"
    )
    distortion_right: tuple[float, ...] | None = Field(
        default=None, description="of the right lens; left out: as the left one's"
    )

    @field_validator("distortion", "distortion_right")
    @classmethod
    def _as_many_as_there_are(cls, numbers: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if numbers is not None and len(numbers) > MAX_NUMBERS:
            raise ValueError(f"has {len(numbers)} numbers; give at most 8: k1, k2, p1, p2, k3, k4, k5, k6")
        return numbers

    @model_validator(mode="after")
    def _lenses_reach_the_corners(self) -> CameraSection:
        across = max(abs(self.cx_px), abs(self.width_px - 1 - self.cx_px)) / self.fx_px
        down = max(abs(self.cy_px), abs(self.height_px - 1 - self.cy_px)) / self.fy_px
        corner = float(np.hypot(across, down))
        for field, numbers in (("distortion", self.distortion), ("distortion_right", self.distortion_right)):
            reached = _bends_back_at(numbers or (), corner)
            if reached is not None:
                raise ValueError(
                    f"{field}: the picture's corner lies {corner:.2f} focal lengths from its middle, and a lens "
                    f"of these numbers bends back at {reached:.2f}; give numbers that hold up to the corner"
                )
        return self

    def distortions(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Of the left and of the right lens; empty: a pinhole."""
        return self.distortion, self.distortion if self.distortion_right is None else self.distortion_right

    def pose_base_camera(self) -> Pose:
        """The left camera in the base frame; the rotation is made orthonormal."""
        return Pose.from_matrix([*self.matrix_base_camera, (0.0, 0.0, 0.0, 1.0)])


def _bends_back_at(numbers: tuple[float, ...], corner: float) -> float | None:
    """The radius, in focal lengths, at which the distortion folds back; None if that is beyond the picture's corner."""
    k1, k2, _, _, k3, k4, k5, k6 = (*numbers, *(0.0,) * (MAX_NUMBERS - len(numbers)))
    r = np.linspace(0.0, 4.0 * corner, RADII)
    r2 = r * r
    with np.errstate(all="ignore"):
        bent = r * (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    grows = np.concatenate([np.diff(bent) > 0.0, [False]])
    last = int(np.argmin(grows))
    return None if bent[last] >= corner else float(bent[last])
