"""Commands to the recorder."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.messages.base import Message


class StartRecording(Message):
    """Begin a new file; a running one is finished first."""

    name: str = ""


class StopRecording(Message):
    """Finish the file."""


class RecordingStatus(Message):
    """The recorder's file. `dropped` counts what it could not take, key by key."""

    recording: bool
    path: str = Field(default="", description="the recording: its first file")
    messages: int = 0
    channels: int = 0
    bytes_written: int = 0
    dropped: dict[str, int] = Field(default_factory=dict)
    parts: tuple[str, ...] = Field(
        default=(), description="its files in order: more than one where the recorder had to begin again"
    )
    trouble: str = Field(default="", description="why nothing is being recorded though it was asked for")
    warnings: tuple[str, ...] = Field(
        default=(), description="what is missing from the recording, in words, if it matters"
    )
