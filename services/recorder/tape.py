"""One recording: the file that is being written, and the files before it."""

from __future__ import annotations

import contextlib
import errno
import shutil
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO

from crosspih_common.recording.parts import parts_of
from services.recorder.config import RecorderConfig
from services.recorder.file import RecordingFile, create_file, create_part
from services.recorder.for_viewers import ForViewers
from services.recorder.sample import Sample

Metadata = Mapping[str, Mapping[str, str]]


class DiskFull(OSError):
    """Less space is free than `recorder.min_free_bytes`."""


def why_of(error: Exception) -> str:
    """A short text for an error."""
    return (error.strerror or str(error)) if isinstance(error, OSError) else f"{type(error).__name__}: {error}"


class Tape:
    """A recording under way. `file` is None while the disk cannot be written; `warnings` name the missing samples.

    `messages`, `channels` and `bytes_written` count what this process wrote.
    """

    def __init__(
        self, config: RecorderConfig, metadata: Callable[[], Metadata], name: str, first: Path | None = None,
        number: int = 1, viewers: ForViewers | None = None,
    ) -> None:  # fmt: skip
        self._config, self._metadata = config, metadata
        self.name, self._first, self._number = name, first, number
        self.viewers = viewers
        self.file: RecordingFile | None = None
        self.parts: list[Path] = [] if first is None else [part for part in parts_of(first) if part.exists()]
        self.warnings: list[str] = []
        self.trouble = ""
        self._channels = 0
        self._messages = self._bytes = 0
        self._try_at = 0.0

    @property
    def messages(self) -> int:
        """In all files."""
        return self._messages + (0 if self.file is None else self.file.messages)

    @property
    def channels(self) -> int:
        """How many keys have sent samples, in the file that has most."""
        return max(self._channels, 0 if self.file is None else self.file.channels)

    @property
    def bytes_written(self) -> int:
        """In all files."""
        return self._bytes + (0 if self.file is None else self.file.bytes_written())

    def begin(self, states: list[Sample]) -> Path:
        """Make the first file, with the known states at its beginning. Raises OSError, and leaves no file then."""
        self._require_room()
        path, stream = create_file(self._config.directory, self.name)
        self._first = path
        self._open(path, stream, states)
        return path

    def go_on(self, states: list[Sample]) -> Path:
        """Make the next part. Raises OSError, and leaves no file then."""
        if self._first is None:
            return self.begin(states)
        self._try_at = time.monotonic() + self._config.retry_s
        self._require_room()
        path, number, stream = create_part(self._first, self._number)
        self._number = number
        self._open(path, stream, states)
        return path

    def _open(self, path: Path, stream: IO[bytes], states: list[Sample]) -> None:
        words = self._metadata()
        told = {
            **words.get("recording", {}),
            "name": self.name,
            "part": str(self._number),
            "first": (self._first or path).name,
        }
        try:
            file = RecordingFile(path, stream, self._config, {**words, "recording": told})
            for state in states:
                file.write(state)
            file.flush()
            if self.viewers is not None:
                self.viewers.begin(file)
                self.viewers.offer(states)
        except BaseException:
            with contextlib.suppress(OSError):
                stream.close()
            path.unlink(missing_ok=True)
            if path == self._first:
                self._first = None
            raise
        self._number += 1
        self.file, self.trouble = file, ""
        self.parts.append(path)

    def _require_room(self) -> None:
        folder = self._config.directory.resolve()
        while not folder.exists():
            folder = folder.parent
        free = shutil.disk_usage(folder).free
        if free < self._config.min_free_bytes:
            raise DiskFull(
                errno.ENOSPC,
                f"{free / 1e6:.1f} MB are free, less than recorder.min_free_bytes ({self._config.min_free_bytes})",
            )

    def may_try_again(self) -> bool:
        """Whether it is time to try a disk that failed."""
        return time.monotonic() >= self._try_at

    def let_go(self, error: Exception) -> Counter[str]:
        """Give up a file that cannot be written: keep its complete part. Returns how many samples of
        each key are lost.
        """
        file = self.file
        assert file is not None
        self.file, self.trouble = None, f"{file.path}: {why_of(error)}"
        self._try_at = time.monotonic() + self._config.retry_s
        self._channels = max(self._channels, file.channels)
        lost = file.abandon()
        if file.path.exists():
            self._messages += file.messages
            self._bytes += file.path.stat().st_size
            return lost
        self.parts.remove(file.path)
        if file.path == self._first:
            self._first, self._number = None, 1
        return lost

    def show(self, within_s: float | None) -> None:
        """Write viewers' messages that wait, for at most this long. Raises OSError."""
        if self.viewers is not None and self.file is not None:
            self.viewers.work(self.file, within_s)

    def finish(self, metadata: Metadata) -> None:
        """Write the end of the file. Raises OSError."""
        file = self.file
        assert file is not None
        file.flush()
        self.show(None)
        if self.viewers is not None:
            metadata = {**metadata, "foxglove": self.viewers.metadata()}
        self._bytes += file.finish(metadata)
        self._messages += file.messages
        self._channels = max(self._channels, file.channels)
        self.file = None
