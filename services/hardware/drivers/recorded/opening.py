"""The recorded cell: a file, checked against the cell's own, and the devices that it has."""

from __future__ import annotations

import sys
from collections.abc import Callable

from crosspih_common.errors import ConfigError
from services.hardware.drivers.recorded.checking import (
    cell_then,
    landing_then,
    require_same_arm,
    require_same_camera,
    require_same_cell,
)
from services.hardware.drivers.recorded.devices import RecordedCamera, RecordedJoints, RecordedWrench, pairs_from
from services.hardware.drivers.recorded.film import (
    FIELD,
    begun_ns,
    joint_track,
    open_recording,
    picture_track,
    wrench_track,
)
from services.hardware.drivers.recorded.playback import Playback
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.wall_pace import WallPace
from services.hardware.protocols import Devices


def open_devices(request: OpenRequest) -> Devices:
    """The devices of `hardware.recorded.file`. In real time it plays from the start on; else in the cycles that motions
    ask for.

    Says on standard error what it plays. Raises ConfigError naming the field: no file, not whole, a channel that is
    missing, another cell.
    """
    config, workcell = request.config.recorded, request.workcell
    if config.file is None:
        raise ConfigError(f"{FIELD}: names no recording; the driver `recorded` needs one")
    recording = open_recording(config.file, config.torn)
    known = require_same_cell(recording, workcell, request.wanted)
    said = [f"recorded cell: {config.file} from {config.from_s:g} s" + ("" if recording.finished else ", torn off")]
    devices = Devices(realtime=request.realtime)
    playback: Playback | None = None
    if {"arm", "force_torque"} & request.wanted:
        pace: Callable[[int], None] = WallPace(config.speed) if request.realtime else lambda now_ns: None
        track = joint_track(recording)
        require_same_arm(track, workcell, config.file)
        playback = Playback(
            track, config.from_s, config.period_s, config.tolerance_rad, workcell.arm().limits.speed_rad_s, pace
        )
        wrench = wrench_track(recording)
        devices.landing = landing_then(cell_then(recording))
        devices.joints = RecordedJoints(playback, workcell.arm())
        devices.wrench = RecordedWrench(playback, wrench)
        said.append(
            f"joint states every {track.period_ns * 1e-6:g} ms"
            + (f", in between interpolated every {playback.period_ns * 1e-6:g} ms" if playback.interpolated else "")
            + f"; every sample of the sensor, at {1e9 / wrench.period_ns:g} Hz"
            + (f", with {wrench.gaps} gaps where samples were lost" if wrench.gaps else "")
        )
    if "camera" in request.wanted:
        pairs, lost = picture_track(recording)
        left = pairs_from(pairs, begun_ns(recording) + round(config.from_s * 1e9))
        if not left:
            raise ConfigError(f"hardware.recorded.from_s: after {config.from_s:g} s {config.file} has no pictures")
        if not known:
            require_same_camera(left[0], workcell, config.file)
        devices.camera = RecordedCamera(left, playback, request.realtime, config.picture_wait_s, config.speed)
        said.append(f"{len(left)} pairs of pictures" + (f", {lost} more are not whole" if lost else ""))
    if not known:
        said.append("it does not say of which cell it is: arm and picture size were compared alone")
    print("; ".join(said), file=sys.stderr, flush=True)
    return devices
