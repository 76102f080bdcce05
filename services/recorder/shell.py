"""Binds the recorder to the bus: a tap on every topic of the table, and the commands start and stop."""

from __future__ import annotations

import platform
from collections.abc import Callable
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from crosspih_common.bus import Bus
from crosspih_common.bus.traffic import KeyCounters
from crosspih_common.bus.transport import Tap
from crosspih_common.keys import RECORD_START, RECORD_STOP, Topic, topics
from crosspih_common.messages import RecordingStatus, Severity, StartRecording, StopRecording
from crosspih_common.service import ServiceContext
from crosspih_common.service.wall_clock import this_host
from services.recorder.broken_off import BrokenOff, broken_off
from services.recorder.config import RecorderConfig
from services.recorder.for_viewers import ForViewers
from services.recorder.recorder import Recorder

LIBRARIES = ("crosspih", "eclipse-zenoh", "mcap", "foxglove-schemas-protobuf", "numpy", "pydantic", "scipy")


def library_versions() -> dict[str, str]:
    """The versions of the libraries in this process."""
    versions = {"python": platform.python_version(), "platform": platform.platform()}
    for name in LIBRARIES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def tap_all(bus: Bus, recorder: Recorder) -> None:
    """Give the recorder every sample of every topic, on the bus's own thread."""
    for topic in topics():
        bus.tap(topic, _taker_of(bus, recorder, topic), recorder.refused)


def _taker_of(bus: Bus, recorder: Recorder, topic: Topic[Any]) -> Callable[[str, KeyCounters], Tap]:
    def taker(key: str, counts: KeyCounters) -> Tap:
        def on_full() -> None:
            counts.dropped += 1

        return recorder.taker(topic, key, on_full, lambda why: bus.traffic.reject(key, why))

    return taker


class RecorderShell:
    """The recorder on the bus."""

    def __init__(self, context: ServiceContext, config: RecorderConfig) -> None:
        self._context, self._config = context, config
        self._recorder = Recorder(config, self._metadata, self._tell, self._left_behind, self._for_viewers)
        context.works.watch("the recorder's writer", lambda: self._recorder.writes)
        bus = context.bus
        tap_all(bus, self._recorder)
        bus.serve(RECORD_START, self._start)
        bus.serve(RECORD_STOP, self._stop)

    def _metadata(self) -> dict[str, dict[str, str]]:
        cell = self._context.cell
        wall = self._context.wall_difference
        return {
            "cell": {"name": cell.workcell.name, "path": str(cell.path.resolve()), "yaml": cell.text},
            "versions": library_versions(),
            "recording": {
                "started": datetime.now(timezone.utc).isoformat(timespec="milliseconds"),
                "boot_id": self._context.bus.clock.boot_id,
            },
            # log times are this machine's clock, stamps the cell's
            "wall_clock": {
                "host": this_host(),
                "cells_host": "" if wall is None else wall.host,
                "ahead_s": "" if wall is None else f"{wall.offset_s:.6f}",
                "bound_s": "" if wall is None else f"{wall.bound_s:.6f}",
            },
        }

    def _left_behind(self) -> BrokenOff | bool | None:
        """The recording that a predecessor left; False while the cell's clock has not yet told which run of the cell
        this is.
        """
        boot_id = self._context.bus.clock.boot_id
        if not boot_id:
            return False
        return broken_off(
            self._config.directory.resolve(), self._context.cell.workcell.name, boot_id, self._config.resume_s
        )

    def _for_viewers(self) -> ForViewers | None:
        return ForViewers(self._context.cell.workcell, self._config.foxglove_hz) if self._config.foxglove else None

    def _tell(self, code: str, text: str) -> None:
        if code == "recording_failed":
            self._context.reason = "nothing is recorded: " + text
        elif code == "recording_resumed":
            self._context.reason = ""
        self._context.event(Severity.ERROR if code == "recording_failed" else Severity.WARNING, code, text)

    def _start(self, request: StartRecording) -> RecordingStatus:
        status = self._recorder.start(request.name, request.stamp_ns)
        self._context.reason = "" if status.recording else f"nothing is recorded: {status.trouble}"
        return status

    def _stop(self, request: StopRecording) -> RecordingStatus:
        self._context.reason = ""
        return self._recorder.stop(request.stamp_ns)

    def close(self) -> None:
        """Finish the file."""
        self._recorder.close()
