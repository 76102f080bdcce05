"""The stereo camera: what it is, and a pair of pictures."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.messages.base import Frame, Message, PoseData


class CameraCalibration(Message):
    """Two parallel pinhole cameras; the right one sits `baseline_m` along the left one's +x."""

    frame: Frame = Frame.BASE
    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    fx_px: float = Field(gt=0.0)
    fy_px: float = Field(gt=0.0)
    cx_px: float
    cy_px: float
    baseline_m: float = Field(gt=0.0)
    pose_base_camera: PoseData


class CaptureStereo(Message):
    """Take a pair now. The two images come on their own keys, stamped like the reply.

    Another light is for a picture that was refused: a driver that cannot change it may ignore both fields.
    """

    exposure_scale: float = Field(default=1.0, gt=0.0, le=64.0, description="factor on the camera's usual exposure")
    lamp: int = Field(default=0, ge=0, le=7, description="which of the cell's lamps is lit; 0 is the usual one")


class StereoPair(Message):
    """The pair that was taken: the images carry this `stamp_ns` on camera/left/image and camera/right/image."""

    frame: Frame = Frame.CAMERA_LEFT
    capture_id: int
    calibration: CameraCalibration
    exposure_s: float
