"""How a camera is set when it is opened: format, region, exposure, clock, trigger, each against what the camera can."""

from __future__ import annotations

import time

from crosspih_common.errors import ConfigError
from crosspih_common.messages.camera import CameraModel
from services.hardware.drivers.genicam.config import GenicamConfig
from services.hardware.drivers.genicam.features import FIELD, Features
from services.hardware.drivers.genicam.formats import NAMES, OLD_NAMES, code_of


def set_up(features: Features, side: str, config: GenicamConfig, lens: CameraModel) -> None:
    """Set all of the cell's file, each read back. Raises ConfigError; AravisError when nobody answers."""
    if code_of(config.pixel_format) is None:
        raise ConfigError(
            f"{FIELD}.pixel_format: {config.pixel_format!r} has no encoding on the bus; want one of "
            f"{', '.join(NAMES)} (packed formats: take the one without 'Packed' or 'p')"
        )
    spelled = {OLD_NAMES.get(entry, entry): entry for entry in features.entries("PixelFormat")}
    wanted = OLD_NAMES.get(config.pixel_format, config.pixel_format)
    features.choose("PixelFormat", spelled.get(wanted, config.pixel_format), "pixel_format")
    _set_region(features, side, config, lens)
    features.automatics_off()
    low_s, high_s = features.exposure_bounds_s()
    if not low_s <= config.exposure_s <= high_s:
        raise ConfigError(
            f"{FIELD}.exposure_s: ExposureTime of {features.who} takes {low_s:g} to {high_s:g} s, "
            f"not {config.exposure_s:g}"
        )
    got_s = features.set_exposure_s(config.exposure_s)
    if abs(got_s - config.exposure_s) > max(2e-5, 0.05 * config.exposure_s):
        raise ConfigError(
            f"{FIELD}.exposure_s: {features.who} exposes {got_s:g} s, asked for {config.exposure_s:g}; it may be bound "
            "by the frame rate: switch AcquisitionFrameRateEnable off in the camera"
        )
    if config.gain is not None:
        features.set_gain(config.gain)
    _set_clock(features, config)
    _set_trigger(features, side, config)


def _set_region(features: Features, side: str, config: GenicamConfig, lens: CameraModel) -> None:
    offset, wanted = config.offset_px, (lens.width_px, lens.height_px)
    if offset is not None:
        for name in ("OffsetX", "OffsetY"):
            if features.has(name):
                features.set_integer(name, 0, "offset_px")
        for name, value in zip(("Width", "Height"), wanted, strict=True):
            features.set_integer(name, value, f"calibration: {side}")
        for name, value in zip(("OffsetX", "OffsetY"), offset, strict=True):
            if value or features.has(name):
                features.set_integer(name, value, "offset_px")
    delivered = features.integer("Width"), features.integer("Height")
    if delivered != wanted:
        raise ConfigError(
            f"{FIELD}.calibration: {side} says {wanted[0]} x {wanted[1]}, {features.who} delivers {delivered[0]} "
            f"x {delivered[1]}; calibrate at that size, or set {FIELD}.offset_px: [x, y], the corner of a region "
            "as large as the calibration says"
        )


def _set_clock(features: Features, config: GenicamConfig) -> None:
    if config.clock != "ptp":
        return
    enable = features.first_of("PtpEnable", "GevIEEE1588")
    if enable is None:
        raise ConfigError(f"{FIELD}.clock: {features.who} has no PtpEnable; use clock: own")
    features.switch(enable, True, "clock")
    status = "PtpStatus" if enable == "PtpEnable" else "GevIEEE1588Status"
    until = time.monotonic() + config.ptp_wait_s
    while (said := features.text(status)) not in ("Master", "Slave"):
        if time.monotonic() > until:
            raise ConfigError(
                f"{FIELD}.clock: {features.who} says {status} {said} after {config.ptp_wait_s:g} s, want Master "
                "or Slave; both cameras must be in one network whose switch passes PTP; or use clock: own"
            )
        if features.has("PtpDataSetLatch"):
            features.run("PtpDataSetLatch")
        time.sleep(0.1)


def _set_trigger(features: Features, side: str, config: GenicamConfig) -> None:
    source = "Software"
    if config.trigger == "wire" and config.wire is not None:
        if side == "left":
            features.choose("LineSelector", config.wire.left_output, "wire.left_output")
            if features.has("LineMode"):
                features.choose("LineMode", "Output", "wire.left_output")
            features.choose("LineSource", "ExposureActive", "wire.left_output")
        else:
            source = config.wire.right_input
    if features.has("TriggerSelector") and "FrameStart" in features.entries("TriggerSelector"):
        features.choose("TriggerSelector", "FrameStart", "trigger")
    features.choose("TriggerSource", source, "trigger" if source == "Software" else "wire.right_input")
    features.trigger_by(source)
