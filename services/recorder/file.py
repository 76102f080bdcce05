"""One MCAP file being written: a recording, or a part of one."""

from __future__ import annotations

import contextlib
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap.writer import CompressionType, Writer

from crosspih_common.bus.codec import label_of
from crosspih_common.foxglove import ViewerTopic
from crosspih_common.foxglove.own_messages import channel_schema
from crosspih_common.keys import Topic
from crosspih_common.recording.parts import part_path
from crosspih_common.recording.records import sealed
from crosspih_common.recording.scanning import DEFINITIONS, LIBRARY
from services.recorder.config import Compression, RecorderConfig
from services.recorder.sample import Sample, Waiting

_COMPRESSION = {
    Compression.ZSTD: CompressionType.ZSTD,
    Compression.LZ4: CompressionType.LZ4,
    Compression.NONE: CompressionType.NONE,
}
_UNFIT = re.compile(r"[^A-Za-z0-9._-]+")


def create_file(directory: Path, name: str) -> tuple[Path, IO[bytes]]:
    """Create `<directory>/<name>-<counter>.mcap`; the counter is one more than the highest there. Never overwrites.

    Raises OSError when the directory or the file cannot be made.
    """
    directory = directory.resolve()
    directory.mkdir(parents=True, exist_ok=True)
    stem = _UNFIT.sub("_", name).strip("._-")[:80] or "recording"
    # also count recordings of which only a later part is left: their name is taken
    numbered = re.compile(re.escape(stem) + r"-(\d+)(\.part\d+)?\.mcap")
    taken = [int(match.group(1)) for entry in directory.iterdir() if (match := numbered.fullmatch(entry.name))]
    number = max(taken, default=0) + 1
    while True:
        path = directory / f"{stem}-{number:04d}.mcap"
        try:
            return path, path.open("xb")
        except FileExistsError:
            number += 1


def create_part(first: Path, number: int) -> tuple[Path, int, IO[bytes]]:
    """Create the next part of a recording, numbered from that number on: (path, number, stream). Never overwrites.

    Raises OSError.
    """
    first.parent.mkdir(parents=True, exist_ok=True)
    while True:
        path = part_path(first, number)
        try:
            return path, number, path.open("xb")
        except FileExistsError:
            number += 1


class RecordingFile:
    """Writes samples as they are: payload bytes as message data, `seq` as sequence, cell time as log time.

    Each schema and channel is written twice: in the chunk of its first message, and in an attachment after it. So one
    damaged chunk does not make all later messages unreadable. Every method may raise OSError (a full disk); after that
    only `abandon` may be called.
    """

    def __init__(
        self, path: Path, stream: IO[bytes], config: RecorderConfig, metadata: Mapping[str, Mapping[str, str]]
    ) -> None:
        self.path = path
        self._stream = stream
        self._writer = Writer(stream, chunk_size=config.chunk_bytes, compression=_COMPRESSION[config.compression])
        self._schemas: dict[type | str, int] = {}
        self._channels: dict[str, int] = {}
        self._shown: dict[ViewerTopic, list[int]] = {}  # channel and its number of messages
        self._any_shown = False
        self._repeat = RecordBuilder()
        self._flushed_bytes = self._flushed_messages = 0
        self._unflushed: list[str] = []  # the key of each sample since the last flush
        self._writer.start(profile="", library=LIBRARY)
        for name, entries in metadata.items():
            self._writer.add_metadata(name, sealed(name, entries))
        self._flush()

    @property
    def messages(self) -> int:
        """How many samples were added."""
        return self._flushed_messages + len(self._unflushed)

    @property
    def channels(self) -> int:
        """How many keys have sent samples."""
        return len(self._channels)

    def bytes_written(self) -> int:
        """The size so far."""
        return 0 if self._stream.closed else self._stream.tell()

    def write(self, sample: Sample) -> None:
        """Add a sample to the chunk that is being filled."""
        self.write_all(iter((sample,)))

    def write_all(self, samples: Iterator[Waiting]) -> None:
        """Add samples until none is left or one cannot be written."""
        channels, add, note = self._channels, self._writer.add_message, self._unflushed.append
        for sample in samples:
            key, topic, payload, seq, stamp_ns, wall_ns = sample
            channel = channels.get(key) or self._register(key, topic)
            note(key)
            add(channel, stamp_ns if stamp_ns > 0 else 0, payload, wall_ns, seq & 0xFFFFFFFF if seq > 0 else 0)

    def _register(self, key: str, topic: Topic[Any]) -> int:
        name, encoding, message_encoding, data = channel_schema(topic.type)
        schema = self._schemas.get(topic.type)
        if schema is None:
            schema = self._schemas[topic.type] = self._registered(name, encoding, data)
        words = {
            "label": label_of(topic.type),
            "path": topic.path,
            "kind": topic.kind.value,
            "publisher": topic.publisher,
            "doc": topic.doc,
        }
        channel = self._channels[key] = self._channel(key, message_encoding, schema, words)
        return channel

    def _registered(self, name: str, encoding: str, data: bytes) -> int:
        schema: int = self._writer.register_schema(name, encoding, data)
        Schema(id=schema, name=name, encoding=encoding, data=data).write(self._repeat)
        return schema

    def _channel(self, name: str, message_encoding: str, schema: int, words: dict[str, str]) -> int:
        channel = self._writer.register_channel(name, message_encoding, schema, words)
        Channel(id=channel, topic=name, message_encoding=message_encoding, schema_id=schema, metadata=words).write(
            self._repeat
        )
        return channel

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Add a file to the file."""
        self._writer.add_attachment(0, 0, name, media_type, data)

    def show(self, topic: ViewerTopic, stamp_ns: int, wall_ns: int, data: bytes) -> None:
        """Add a message for viewers. Call it after `flush` and before `flush_shown`, so that it shares no chunk with a
        sample.
        """
        channel = self._shown.get(topic)
        if channel is None:
            name, encoding, message_encoding, schema_data = topic.channel_schema()
            schema = self._schemas.get(name)
            if schema is None:
                schema = self._schemas[name] = self._registered(name, encoding, schema_data)
            words = {"kind": topic.kind.value, "for": "viewers", "doc": topic.doc}
            channel = self._shown[topic] = [self._channel(topic.name, message_encoding, schema, words), 0]
        self._any_shown = True
        self._writer.add_message(channel[0], stamp_ns, data, wall_ns, channel[1] & 0xFFFFFFFF)
        channel[1] += 1

    def flush_shown(self) -> None:
        """Close the chunk with messages for viewers."""
        if self._any_shown:
            self._any_shown = False
            self._flush()

    def flush(self) -> None:
        """Close the chunk and hand everything to the operating system: a kill after this loses none of it."""
        if self._unflushed:
            self._flush()

    def _flush(self) -> None:
        self._close_chunk()
        self._stream.flush()
        self._flushed_bytes, self._flushed_messages = self._stream.tell(), self.messages
        self._unflushed.clear()

    def _close_chunk(self) -> None:
        self._writer.flush()  # type: ignore[no-untyped-call]
        if self._repeat.count:
            data = zstandard.compress(self._repeat.end())  # type: ignore[no-untyped-call]
            self._writer.add_attachment(0, 0, DEFINITIONS, "application/zstd", data)

    def finish(self, metadata: Mapping[str, Mapping[str, str]]) -> int:
        """Write what remains, the last metadata, the index and the footer, and sync them to the disk;
        returns the size.
        """
        self._close_chunk()
        for name, entries in metadata.items():
            self._writer.add_metadata(name, sealed(name, entries))
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.flush()
        os.fsync(self._stream.fileno())
        size = self._stream.tell()
        self._stream.close()
        return size

    def abandon(self) -> Counter[str]:
        """Give up a file that cannot be written any more. What was flushed stays and what was not is cut off; a file
        without a message is removed. Returns how many samples of each key are lost.
        """
        with contextlib.suppress(OSError, ValueError):
            self._stream.close()  # closing it may try to write what it still buffers
        with contextlib.suppress(OSError):
            if self._flushed_messages == 0:
                self.path.unlink()
            else:
                os.truncate(self.path, self._flushed_bytes)
        lost = Counter(self._unflushed)
        self._unflushed.clear()
        return lost
