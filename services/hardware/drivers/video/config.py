"""Which devices or files, and how they are set: the section `hardware.video` of a cell's file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from crosspih_common.config.section import Section

Source = Annotated[str, Field(min_length=1, max_length=4096)]


class VideoConfig(Section):
    """Two sources, or one whose picture holds both sides. A source is a device (/dev/video0, or better its stable name
    below /dev/v4l/by-id), the address of a stream (http://...), a video file, or a sequence such as left%03d.png."""

    left: Source
    right: Source | None = Field(default=None, description="left out: each picture of `left` holds both, side by side")
    calibration: Path = Field(
        description="the camera message as YAML or JSON; without pose_base_camera the cell's own is taken"
    )
    format: Literal["MJPG", "YUYV", "GREY"] | None = Field(
        default=None, description="of a device: MJPG is faster over USB 2, YUYV loses nothing; left out: as it is"
    )
    frame_rate_hz: float | None = Field(default=None, gt=0.0, le=500.0, description="of a device; left out: as it is")
    colour: bool = Field(default=False, description="send rgb8; else grey")
    exposure_s: float = Field(default=0.01, gt=0.0, le=10.0, description="the usual exposure")
    set_exposure: bool = Field(default=True, description="of a device; false leaves its automatic on")
    exposure_unit_s: float = Field(default=1e-4, gt=0.0, description="1 of the device's exposure: 0.1 ms in Linux")
    gain: float | None = Field(default=None, description="in the device's own unit; left out: as it is")
    settle_frames: int = Field(default=2, ge=0, le=30, description="thrown away after the exposure was changed")
    delay_s: float = Field(
        default=0.0, ge=0.0, le=2.0, description="from the end of an exposure until its picture is here, at the most"
    )
    skew_most_s: float = Field(default=0.05, gt=0.0, description="how far apart two devices' pictures may come")
    frame_wait_s: float = Field(default=2.0, gt=0.0, le=30.0, description="for a fresh picture to come")
    patience_s: float = Field(default=15.0, ge=0.0, le=120.0, description="for a device that is away to come back")
