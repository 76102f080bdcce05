"""Figures of an assembly from the recording on the third host: its missing samples, and how the arm stopped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel

from crosspih_common.keys import ADMITTANCE_MOVE, FOLLOW, GUARDED_MOVE, JOINT_STATE, LEASE_BEAT, MOVE_LINEAR, Command
from crosspih_common.messages import StopReason
from crosspih_common.recording import Recording, RecordingError, read_recording

MOTIONS: tuple[Command[Any, Any], ...] = (FOLLOW, MOVE_LINEAR, GUARDED_MOVE, ADMITTANCE_MOVE)
AT_REST_RAD_S = 1e-3
HOLDER = "planning"


class RecordingFigures(BaseModel):
    """Of one recording. `rest_s`: from the last beat of the holder before the arm dropped it to the arm at rest, by log
    times; None where the holder was not lost.
    """

    samples: int = 0
    missing: int = 0
    rest_s: float | None = None
    wall_ahead_s: float | None = None  # the recorder's wall clock relative to the cell's


def kept(path: str | None) -> RecordingFigures:
    """The figures; empty where there is no readable recording."""
    if path is None or not Path(path).exists():
        return RecordingFigures()
    try:
        recording = read_recording(path)
    except RecordingError:
        return RecordingFigures()
    ahead = recording.metadata.get("wall_clock", {}).get("ahead_s", "")
    return RecordingFigures(
        samples=sum(len(samples) for samples in recording.samples.values()),
        missing=sum(recording.seq_gaps().values()),
        rest_s=_rest_s(recording),
        wall_ahead_s=float(ahead) if ahead else None,
    )


def _rest_s(recording: Recording) -> float | None:
    lost_ns = [
        reply.wall_ns
        for command in MOTIONS
        for reply in recording.sent(command.reply_echo)
        if reply.value.stop_reason is StopReason.HOLDER_LOST
    ]
    if not lost_ns:
        return None
    beats_ns = [
        beat.wall_ns
        for beat in recording.sent(LEASE_BEAT)
        if beat.value.holder == HOLDER and beat.value.lease and beat.wall_ns < min(lost_ns)
    ]
    if not beats_ns:
        return None
    still_ns = [
        state.wall_ns
        for state in recording.sent(JOINT_STATE)
        if state.wall_ns > max(beats_ns) and max(abs(speed) for speed in state.value.speeds_rad_s) < AT_REST_RAD_S
    ]
    return (min(still_ns) - max(beats_ns)) * 1e-9 if still_ns else None
