"""Which files the cameras show."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from crosspih_common.config.section import Section


class PicturesConfig(Section):
    """The pairs that the driver `pictures` shows; paths are from where the service is started, or absolute."""

    left: tuple[Path, ...] = Field(default=(), description="PNG, TIFF or any format of OpenCV's, 8 or 16 bits")
    right: tuple[Path, ...] = Field(default=(), description="as many as `left`: the other picture of each pair")
    calibration: Path | None = Field(
        default=None, description="the camera message as YAML or JSON; without pose_base_camera the cell's own is taken"
    )
    exposure_s: float = Field(default=0.02, gt=0.0, le=10.0, description="said to be the usual exposure")
