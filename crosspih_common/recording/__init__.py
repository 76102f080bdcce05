"""Recordings: MCAP files of everything that was said on a cell's bus."""

from crosspih_common.recording.reader import Recorded, Recording, RecordingError, Sent, read_recording

__all__ = ["Recorded", "Recording", "RecordingError", "Sent", "read_recording"]
