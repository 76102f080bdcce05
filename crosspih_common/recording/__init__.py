"""Recordings: MCAP files of all messages on a cell's bus."""

from crosspih_common.recording.parts import parts_of
from crosspih_common.recording.reader import (
    OVERTAKEN_NS,
    ReadPart,
    Recorded,
    Recording,
    RecordingError,
    Sent,
    read_recording,
)

__all__ = [
    "OVERTAKEN_NS",
    "ReadPart",
    "Recorded",
    "Recording",
    "RecordingError",
    "Sent",
    "parts_of",
    "read_recording",
]
