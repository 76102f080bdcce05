"""Opens the sources of `hardware.video`: what is wrong with a setting is said when the service starts."""

from __future__ import annotations

import sys

from crosspih_common.errors import ConfigError
from services.hardware.drivers.calibration_file import read_calibration
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.video.source import FIELD
from services.hardware.drivers.video.stereo import VideoPair
from services.hardware.protocols import Devices


def open_devices(request: OpenRequest) -> Devices:
    """The cameras as devices. Raises ConfigError naming the field and the mend."""
    config = request.config.video
    if config is None:
        raise ConfigError(
            f"{FIELD}: not in the cell's file; it names the sources, left and right, and their calibration"
        )
    if request.wanted - {"camera"}:
        raise ConfigError("hardware.driver: video opens cameras alone; name it for them: drivers: {camera: video}")
    pair = VideoPair(config, read_calibration(config.calibration, f"{FIELD}.calibration", request.workcell))
    print(f"cameras: {config.left}, {config.right or 'both sides in one picture'}", file=sys.stderr, flush=True)
    return Devices(camera=pair, realtime=request.realtime, close=pair.close)
