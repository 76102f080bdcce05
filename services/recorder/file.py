"""One MCAP file being written."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import IO

from mcap.writer import CompressionType, Writer

from crosspih_common.bus.codec import label_of
from services.recorder.config import Compression, RecorderConfig
from services.recorder.sample import Sample
from services.recorder.schemas import channel_schema

_COMPRESSION = {
    Compression.ZSTD: CompressionType.ZSTD,
    Compression.LZ4: CompressionType.LZ4,
    Compression.NONE: CompressionType.NONE,
}
_UNFIT = re.compile(r"[^A-Za-z0-9._-]+")


def create_file(directory: Path, name: str) -> tuple[Path, IO[bytes]]:
    """Make `<directory>/<name>-<counter>.mcap`, the counter one past the highest there. Never overwrites.

    Raises OSError when the directory or the file cannot be made.
    """
    directory = directory.resolve()
    directory.mkdir(parents=True, exist_ok=True)
    stem = _UNFIT.sub("_", name).strip("._-")[:80] or "recording"
    numbered = re.compile(re.escape(stem) + r"-(\d+)\.mcap")
    taken = [int(match.group(1)) for entry in directory.iterdir() if (match := numbered.fullmatch(entry.name))]
    number = max(taken, default=0) + 1
    while True:
        path = directory / f"{stem}-{number:04d}.mcap"
        try:
            return path, path.open("xb")
        except FileExistsError:
            number += 1


class RecordingFile:
    """Writes samples as they are: payload bytes as message data, `seq` as sequence, cell time as log time.

    Every method may raise OSError (a full disk); then only `abandon` makes sense.
    """

    def __init__(
        self, path: Path, stream: IO[bytes], config: RecorderConfig, metadata: Mapping[str, Mapping[str, str]]
    ) -> None:
        self.path = path
        self.messages = 0
        self._stream = stream
        self._writer = Writer(stream, chunk_size=config.chunk_bytes, compression=_COMPRESSION[config.compression])
        self._schemas: dict[type, int] = {}
        self._channels: dict[str, int] = {}
        self._dirty = True
        self._writer.start(profile="", library="crosspih recorder")
        for name, entries in metadata.items():
            self._writer.add_metadata(name, dict(entries))
        self.flush()

    @property
    def channels(self) -> int:
        """How many keys have spoken."""
        return len(self._channels)

    def bytes_written(self) -> int:
        """The size so far."""
        return 0 if self._stream.closed else self._stream.tell()

    def write(self, sample: Sample) -> None:
        """Add a sample to the chunk that is being filled."""
        channel = self._channels.get(sample.key)
        if channel is None:
            channel = self._register(sample)
        self._writer.add_message(
            channel,
            log_time=max(sample.stamp_ns, 0),
            data=sample.payload,
            publish_time=sample.wall_ns,
            sequence=max(sample.seq, 0) & 0xFFFFFFFF,
        )
        self.messages += 1
        self._dirty = True

    def _register(self, sample: Sample) -> int:
        topic = sample.topic
        name, encoding, message_encoding, data = channel_schema(topic.type)
        schema = self._schemas.get(topic.type)
        if schema is None:
            schema = self._schemas[topic.type] = self._writer.register_schema(name, encoding, data)
        self._channels[sample.key] = self._writer.register_channel(
            sample.key,
            message_encoding,
            schema,
            {
                "label": label_of(topic.type),
                "path": topic.path,
                "kind": topic.kind.value,
                "publisher": topic.publisher,
                "doc": topic.doc,
            },
        )
        return self._channels[sample.key]

    def flush(self) -> None:
        """Close the chunk and hand everything to the operating system: a kill after this loses none of it."""
        if self._dirty:
            self._writer.flush()  # type: ignore[no-untyped-call]
            self._dirty = False

    def finish(self, metadata: Mapping[str, Mapping[str, str]]) -> int:
        """Write what remains, the last metadata, the index and the footer, to the disk itself; returns the size."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        for name, entries in metadata.items():
            self._writer.add_metadata(name, dict(entries))
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.flush()
        os.fsync(self._stream.fileno())
        size = self._stream.tell()
        self._stream.close()
        return size

    def abandon(self) -> None:
        """Let go of a file that cannot be written any more; what was flushed stays readable."""
        with contextlib.suppress(OSError, ValueError):
            self._stream.close()
