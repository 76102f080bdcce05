"""Opens the two cameras of `hardware.genicam`: what is wrong with a setting is said when the service starts."""

from __future__ import annotations

from crosspih_common.aravis import load
from crosspih_common.errors import ConfigError
from services.hardware.drivers.calibration_file import calibration_of_cell, read_calibration
from services.hardware.drivers.genicam.camera import CameraAway
from services.hardware.drivers.genicam.features import FIELD
from services.hardware.drivers.genicam.stereo import GenicamPair
from services.hardware.drivers.registry import OpenRequest
from services.hardware.protocols import Devices


def open_pair(request: OpenRequest) -> GenicamPair:
    """The pair, open and set. Raises ConfigError."""
    config = request.config.genicam
    if config is None:
        raise ConfigError(
            f"{FIELD}: not in the cell's file; it names the cameras, left and right, and their calibration"
        )
    if others := sorted(request.wanted - {"camera"}):
        raise ConfigError(
            f"hardware.driver: genicam opens no {others[0]}; name it for the cameras alone: "
            "drivers: {camera: genicam}"
        )
    if config.left == config.right:
        raise ConfigError(f"{FIELD}.left, right: both are {config.left}; a stereo pair has two cameras")
    if config.trigger == "wire" and config.wire is None:
        raise ConfigError(f"{FIELD}.wire: trigger: wire needs it: left_output and right_input")
    if config.calibration is None:
        calibration = calibration_of_cell(request.workcell)
    else:
        calibration = read_calibration(config.calibration, f"{FIELD}.calibration", request.workcell)
    pair = GenicamPair(load(config.library), config, calibration)
    try:
        pair.connect()
    except CameraAway as away:
        pair.close()
        raise ConfigError(f"{FIELD}: {away}") from None
    except BaseException:
        pair.close()
        raise
    return pair


def open_devices(request: OpenRequest) -> Devices:
    """The cameras as devices. Raises ConfigError naming the field and the mend."""
    pair = open_pair(request)
    return Devices(camera=pair, realtime=request.realtime, close=pair.close)
