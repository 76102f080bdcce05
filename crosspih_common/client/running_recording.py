"""The recording of one assembly: its start, its end and what is missing. An assembly also runs without one."""

from __future__ import annotations

import time
from dataclasses import dataclass

from crosspih_common.bus import Bus
from crosspih_common.errors import CommandRefused, CrosspihError
from crosspih_common.keys import RECORD_START, RECORD_STOP
from crosspih_common.messages import RecordingStatus, StartRecording, StopRecording

RECORDER_DEADLINE_S = 60.0
BACK_S = 10.0  # how long to wait at the end for a recorder that was lost
RECORDER_WAIT_S = 1.0  # how long to wait at the start for a recorder; at the end it is asked again
_POLL_S = 0.2


@dataclass(frozen=True, slots=True)
class FinishedRecording:
    """A finished recording: the first file, all files, and what is missing, in words."""

    path: str | None = None
    parts: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


class RunningRecording:
    """A recording under way. `required`: raise CrosspihError if recording fails, instead of a warning at the end."""

    def __init__(self, bus: Bus, name: str, required: bool) -> None:
        self._bus = bus
        self._started: RecordingStatus | None = None
        self.trouble = ""
        try:
            status = bus.call(RECORD_START, StartRecording(name=name), RECORDER_DEADLINE_S, RECORDER_WAIT_S)
        except CrosspihError as error:
            if required or (isinstance(error, CommandRefused) and error.code == "unwritable"):
                raise
            self.trouble = str(error)
            return
        if status.recording:
            self._started = status
        elif required:
            raise CommandRefused("unwritable", status.trouble)
        else:
            self.trouble = status.trouble

    def end(self) -> FinishedRecording:
        """Finish the recording. Never raises: the assembly's result must be returned even when the recorder is lost."""
        started = self._started
        if started is None:
            return FinishedRecording(warnings=(f"nothing was recorded: {self.trouble}",))
        until = time.monotonic() + BACK_S
        while True:
            try:
                status = self._bus.call(RECORD_STOP, StopRecording(), RECORDER_DEADLINE_S, RECORDER_WAIT_S)
                break
            except CrosspihError as error:
                if time.monotonic() >= until:
                    said = f"the recording has no end: the recorder is gone ({error})"
                    return FinishedRecording(started.path, (started.path,), (said,))
                time.sleep(_POLL_S)
        if status.path != started.path:
            said = "the recording ends early: the recorder was started again and did not go on with it"
            trouble = (status.trouble,) if status.trouble else ()
            return FinishedRecording(started.path, (started.path,), (said, *trouble))
        return FinishedRecording(status.path, status.parts or (status.path,), status.warnings)
