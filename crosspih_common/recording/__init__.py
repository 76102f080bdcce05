"""Recordings: MCAP files of everything that was said on a cell's bus."""

from crosspih_common.recording.reader import OVERTAKEN_NS, Recorded, Recording, RecordingError, Sent, read_recording

__all__ = ["OVERTAKEN_NS", "Recorded", "Recording", "RecordingError", "Sent", "read_recording"]
