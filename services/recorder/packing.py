"""mcap's writer with a message's fields packed at once: field by field they take longer than the rest of a recording.

What is written is the same to the byte (tests/recorder/test_packing.py). The library has no way in for this, so that
parts of it are used that it keeps to itself; where it no longer has them, messages are written by the library alone.
"""

from __future__ import annotations

import struct
from typing import IO, Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex
from mcap.writer import CompressionType, Writer

_HEAD = struct.Struct("<BQHIQQ")  # opcode, length of what follows, channel, sequence, log time, publish time
_LENGTH_BYTES = struct.calcsize("<BQ")
_HEAD_IN_LENGTH = _HEAD.size - _LENGTH_BYTES
_MESSAGE = int(Opcode.MESSAGE)
_INDEX_HEAD = struct.Struct("<BQHI")
_INNER = ("_Writer__chunk_builder", "_Writer__statistics", "_Writer__maybe_finalize_chunk")


class _PackedIndex(MessageIndex):
    """A channel's index of one chunk."""

    def write(self, stream: RecordBuilder) -> None:
        """The whole record at once."""
        size = 16 * len(self.records)
        stream.write(_INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + size, self.channel_id, size))
        stream.write(
            struct.pack(f"<{2 * len(self.records)}Q", *(number for record in self.records for number in record))
        )


class PackingWriter(Writer):
    """Use as mcap.writer.Writer, with chunks of so many bytes."""

    def __init__(self, output: IO[bytes], chunk_size: int, compression: CompressionType) -> None:
        super().__init__(output, chunk_size=chunk_size, compression=compression)
        self._chunk_bytes = chunk_size
        inner = [getattr(self, name, None) for name in _INNER]
        self._chunk, self._statistics, self._finalize = inner
        self._packs = None not in inner

    def add_message(self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0) -> None:
        """See mcap.writer.Writer."""
        if not self._packs:
            super().add_message(channel_id, log_time, data, publish_time, sequence)
            return
        chunk: Any = self._chunk
        statistics: Any = self._statistics
        if statistics.message_count == 0 or log_time < statistics.message_start_time:
            statistics.message_start_time = log_time
        if log_time > statistics.message_end_time:
            statistics.message_end_time = log_time
        statistics.channel_message_counts[channel_id] += 1
        statistics.message_count += 1
        if chunk.num_messages == 0 or log_time < chunk.message_start_time:
            chunk.message_start_time = log_time
        if log_time > chunk.message_end_time:
            chunk.message_end_time = log_time
        records: RecordBuilder = chunk.record_writer
        index = chunk.message_indices.get(channel_id)
        if index is None:
            index = chunk.message_indices[channel_id] = _PackedIndex(channel_id, [])
        at, size = records.count, _HEAD_IN_LENGTH + len(data)
        index.records.append((log_time, at))
        chunk.num_messages += 1
        records.write(_HEAD.pack(_MESSAGE, size, channel_id, sequence, log_time, publish_time) + data)
        if at + _LENGTH_BYTES + size > self._chunk_bytes:
            self._finalize()  # type: ignore[misc]
