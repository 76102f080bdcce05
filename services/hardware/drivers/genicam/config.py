"""Which two cameras, and how they are set: the section `hardware.genicam` of a cell's file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from crosspih_common.config.section import Section

Name = Annotated[str, Field(min_length=1, max_length=64)]


class LampConfig(Section):
    """One lamp on an output of a camera: lit before the exposure, dark again when the pictures are there."""

    camera: Literal["left", "right"] = "left"
    line: Name = Field(description="LineSelector: the output that switches it")
    output: Name | None = Field(
        default=None, description="UserOutputSelector that drives the line; left out, LineInverter switches it"
    )
    active_low: bool = Field(default=False, description="the lamp burns while the line is low")


class WireConfig(Section):
    """A wire from the left camera to the right one: the left exposes by software, the right by the wire."""

    left_output: Name = Field(description="the left camera's output, which says ExposureActive")
    right_input: Name = Field(description="the right camera's TriggerSource")


class GenicamConfig(Section):
    """Two GenICam cameras. Left and right are each an address, a serial number, a user's name or a device id."""

    left: Name
    right: Name
    calibration: Path | None = Field(
        default=None,
        description="the camera message as YAML or JSON; without pose_base_camera the cell's own is taken; left out: "
        "cell.camera, until crosspih calibrate stereo has found better",
    )
    pixel_format: Name = Field(default="Mono8", description="PixelFormat of both cameras")
    exposure_s: float = Field(default=0.01, gt=0.0, le=10.0, description="the usual exposure")
    gain: float | None = Field(default=None, description="in the camera's own unit, mostly dB; left out: as it is")
    offset_px: tuple[int, int] | None = Field(
        default=None,
        description="corner of a region as large as the calibration says; left out: the camera's own region must be so",
    )
    packet_size: int | None = Field(
        default=None, ge=256, le=16000, description="bytes; left out: the largest that gets through"
    )
    packet_delay_ns: int | None = Field(default=None, ge=0, le=10_000_000, description="left out: as the camera has it")
    trigger: Literal["software", "wire"] = "software"
    wire: WireConfig | None = None
    clock: Literal["own", "ptp", "shared"] = Field(
        default="own", description="of the two cameras: each its own, made one by PTP, or one already"
    )
    ptp_wait_s: float = Field(default=20.0, ge=0.0, le=120.0, description="for PTP to find its master")
    skew_most_s: float = Field(
        default=0.002, gt=0.0, description="how far apart the exposures may begin, by the cameras' own stamps"
    )
    frame_wait_s: float = Field(default=1.0, gt=0.0, le=30.0, description="after the exposure, for the picture to come")
    retries: int = Field(default=9, ge=0, le=100, description="of a pair that came with losses or apart")
    patience_s: float = Field(default=15.0, ge=0.0, le=120.0, description="for a camera that is away to come back")
    lamps: tuple[LampConfig, ...] = Field(default=(), max_length=8, description="lamp 0, 1, ...")
    lamp_settle_s: float = Field(default=0.005, ge=0.0, le=2.0, description="from the switch to the exposure")
    packet_socket: bool = Field(default=True, description="read the network card's own ring, with CAP_NET_RAW")
    library: str = Field(default="", description="path of libaravis-0.8; left out: the system's, then the wheel's")
