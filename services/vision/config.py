"""The vision service's own settings."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config.correction import MountingCorrection
from crosspih_common.config.section import Section


class ExtraNoise(Section):
    """A worse camera than the simulated one: an error added to every pose, one sd per axis of the hole frame."""

    lateral_m: float = Field(default=0.0, ge=0.0, le=0.02)
    depth_m: float = Field(default=0.0, ge=0.0, le=0.02)
    rotation_rad: float = Field(default=0.0, ge=0.0, le=0.5, description="where the method measures it")


class CalibrationDoubt(Section):
    """The uncertainty of the camera calibration, one standard deviation each. The uncertainty of the hole's pose stands
    in `cell.hole.tolerance`."""

    offset_sd_px: float = Field(default=0.03, ge=0.001, le=2.0, description="the right picture against the left one")
    k1_sd: float = Field(default=0.001, ge=0.0, le=0.5, description="of a lens whose distortion is calibrated")
    k1_untold_sd: float = Field(
        default=0.03, ge=0.0, le=0.5,
        description="of a lens whose calibration says none, or zeros: perhaps nobody looked; 0 for rectified pictures",
    )  # fmt: skip


class VisionConfig(Section):
    """The `vision` section of a cell's file."""

    image_deadline_s: float = Field(default=5.0, gt=0.0, description="wall time the two images of a pair may take")
    capture_deadline_s: float = Field(default=30.0, gt=0.0)
    looks: int = Field(default=3, ge=1, le=8, description="pictures taken, each under another light, before refusing")
    enabled: bool = Field(default=True, description="false: refuse to look, as a cell without cameras would")
    extra_noise: ExtraNoise = ExtraNoise()
    calibration_doubt: CalibrationDoubt = CalibrationDoubt()
    camera_correction: MountingCorrection = Field(
        default=MountingCorrection(), description="of the left camera, in its own frame, on top of its calibration"
    )
