"""The stereo pair of a cell: where it stands and its pinhole numbers."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config.section import Section
from crosspih_common.geometry import Pose


class CameraSection(Section):
    """Two equal parallel pinhole cameras without distortion, as calibrated; z looks ahead, x right, y down.

    A driver that knows its cameras' calibration better says so in `camera/calibration`; the simulated cameras stand
    here. Pixel (u, v) = (fx x/z + cx, fy y/z + cy), with integers at pixel centres, u to the right and v down.
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

    def pose_base_camera(self) -> Pose:
        """The left camera in the base frame; the rotation is made orthonormal."""
        return Pose.from_matrix([*self.matrix_base_camera, (0.0, 0.0, 0.0, 1.0)])
