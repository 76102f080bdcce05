"""A source of pictures opened by OpenCV, set, and read back: a device does not do what it is told, but what it can."""

from __future__ import annotations

import stat
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Protocol

import cv2

from crosspih_common.errors import ConfigError
from services.hardware.drivers.video.config import VideoConfig

FIELD = "hardware.video"
OPEN_MS, READ_MS = 3000, 2000  # of a stream: what is silent so long is away
MANUAL, AUTOMATIC = 1.0, 3.0  # V4L2_EXPOSURE_MANUAL, V4L2_EXPOSURE_APERTURE_PRIORITY
EXPOSURE_TOLERANCE = 0.1
RATE_TOLERANCE = 0.1


class Capture(Protocol):
    """What is used of cv2.VideoCapture."""

    def get(self, prop: int, /) -> float:
        """A property; 0 or -1 where there is none."""

    def set(self, prop: int, value: float, /) -> bool:
        """Ask for a property: the answer is mostly True, whatever came of it."""


class SourceKind(Enum):
    """What a source is; only the first two go on by themselves."""

    DEVICE = "device"
    STREAM = "stream"
    FILE = "file"

    @property
    def live(self) -> bool:
        """Whether pictures come by themselves."""
        return self is not SourceKind.FILE


class SourceAway(Exception):
    """The source cannot be opened, or gives no more pictures."""


@dataclass(frozen=True, slots=True)
class WantedFormat:
    """What a device is to be set to. The size is that of the whole picture."""

    width_px: int
    height_px: int
    format: str | None
    frame_rate_hz: float | None
    exposure_s: float | None  # None: its automatic stays on
    exposure_unit_s: float
    gain: float | None

    @classmethod
    def of(cls, config: VideoConfig, size_px: tuple[int, int]) -> WantedFormat:
        """As the cell's file says."""
        exposure_s = config.exposure_s if config.set_exposure else None
        return cls(*size_px, config.format, config.frame_rate_hz, exposure_s, config.exposure_unit_s, config.gain)


def kind_of(source: str, setting: str) -> SourceKind:
    """What a source is. Raises ConfigError when there is no such thing."""
    if "://" in source:
        return SourceKind.STREAM
    path = Path(source)
    if source.startswith("/dev/"):
        return SourceKind.DEVICE
    if path.exists():
        return SourceKind.DEVICE if stat.S_ISCHR(path.stat().st_mode) else SourceKind.FILE
    if "%" in source:
        if any(path.parent.glob(f"{path.name.split('%')[0]}*{path.suffix}")):
            return SourceKind.FILE
        raise ConfigError(f"{FIELD}.{setting}: no picture is called like {source}")
    raise ConfigError(f"{FIELD}.{setting}: {source} is not there; want a device, a file, or left%03d.png")


def opened(source: str, kind: SourceKind) -> cv2.VideoCapture:
    """The opened source. Raises SourceAway."""
    if kind is SourceKind.DEVICE:
        capture = cv2.VideoCapture(source, cv2.CAP_V4L2)
    elif kind is SourceKind.STREAM:
        timeouts = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_MS]
        capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG, timeouts)
    else:
        capture = cv2.VideoCapture(source, cv2.CAP_IMAGES if "%" in source else cv2.CAP_ANY)
    if not capture.isOpened():
        capture.release()
        raise SourceAway(f"{source} cannot be opened; is it plugged in, and may this user read it (group video)?")
    return capture


def set_up(capture: Capture, wanted: WantedFormat, source: str) -> None:
    """Set a device and read back what it made of it. Raises ConfigError naming the setting and the mend."""
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1.0)  # where it is not heeded the reader drains the queue
    if wanted.format is not None:
        # before the size: which sizes there are depends on it
        capture.set(cv2.CAP_PROP_FOURCC, float(cv2.VideoWriter.fourcc(*wanted.format)))
        got = fourcc_text(capture.get(cv2.CAP_PROP_FOURCC))
        if got != wanted.format:
            raise ConfigError(
                f"{FIELD}.format: {source} gives {got}, asked for {wanted.format}; `v4l2-ctl -d {source} "
                "--list-formats-ext` lists what it can"
            )
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, float(wanted.width_px))
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, float(wanted.height_px))
    size = round(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), round(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    if size != (wanted.width_px, wanted.height_px):
        raise ConfigError(
            f"{FIELD}.calibration: {source} gives {size[0]} x {size[1]}, the calibration wants {wanted.width_px} x "
            f"{wanted.height_px}; calibrate at a size that it has (`v4l2-ctl -d {source} --list-formats-ext`)"
        )
    if wanted.frame_rate_hz is not None:
        capture.set(cv2.CAP_PROP_FPS, wanted.frame_rate_hz)
        rate_hz = capture.get(cv2.CAP_PROP_FPS)
        if abs(rate_hz - wanted.frame_rate_hz) > RATE_TOLERANCE * wanted.frame_rate_hz:
            raise ConfigError(
                f"{FIELD}.frame_rate_hz: {source} gives {rate_hz:g}, asked for {wanted.frame_rate_hz:g}; "
                "format: MJPG allows more over USB 2"
            )
    if wanted.exposure_s is not None:
        set_exposure(capture, wanted.exposure_s, wanted.exposure_unit_s, source, strict=True)
    if wanted.gain is not None:
        capture.set(cv2.CAP_PROP_GAIN, wanted.gain)
        gain = capture.get(cv2.CAP_PROP_GAIN)
        if abs(gain - wanted.gain) > max(0.5, 0.05 * abs(wanted.gain)):
            raise ConfigError(
                f"{FIELD}.gain: {source} keeps {gain:g}, asked for {wanted.gain:g}; "
                f"`v4l2-ctl -d {source} -l` shows its limits"
            )


def set_exposure(capture: Capture, exposure_s: float, unit_s: float, source: str, strict: bool) -> float:
    """Set the exposure by hand; what the device made of it, s. `strict`: raises ConfigError where that is another."""
    capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL)
    if strict and (mode := capture.get(cv2.CAP_PROP_AUTO_EXPOSURE)) != MANUAL:
        raise ConfigError(
            f"{FIELD}.set_exposure: {source} keeps its automatic exposure on ({mode:g}); set_exposure: false leaves "
            "it so"
        )
    capture.set(cv2.CAP_PROP_EXPOSURE, round(exposure_s / unit_s))
    got_s = capture.get(cv2.CAP_PROP_EXPOSURE) * unit_s
    if strict and abs(got_s - exposure_s) > EXPOSURE_TOLERANCE * exposure_s + unit_s:
        raise ConfigError(
            f"{FIELD}.exposure_s: {source} exposes {got_s:g} s, asked for {exposure_s:g}; "
            f"`v4l2-ctl -d {source} -l` shows its limits in units of {FIELD}.exposure_unit_s"
        )
    return got_s


def fourcc_text(value: float) -> str:
    """Four letters of a number, such as MJPG."""
    number = int(value) & 0xFFFFFFFF
    text = "".join(chr((number >> shift) & 0xFF) for shift in (0, 8, 16, 24))
    return text if text.isprintable() and number else "no format"


def kernel_stamp_ns(capture: Any, kind: SourceKind, now_ns: int) -> int | None:
    """When a device's picture came, by the kernel, on the monotonic clock; None where it says nothing sensible."""
    if kind is not SourceKind.DEVICE:
        return None
    stamp_ns = round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
    return stamp_ns if 0 <= now_ns - stamp_ns < 2_000_000_000 else None
