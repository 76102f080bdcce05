"""Walks through a recording's bytes and skips damage: it resumes at the next record with a valid checksum.

After a malformed record the walk searches byte by byte for the start of an intact chunk, metadata record or attachment.
So damage costs only the records that it touches.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import zstandard

from crosspih_common.plain_yaml import require_regular
from crosspih_common.recording.records import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    CHUNK_HEAD,
    DATA_END,
    FRAME,
    HEADER,
    MAGIC,
    MAX_BYTES,
    MESSAGE,
    MESSAGE_INDEX,
    METADATA,
    SCHEMA,
    Attachment,
    Channel,
    Definitions,
    Entry,
    Malformed,
    Metadata,
    Schema,
    Summary,
    attachment_of,
    channel_of,
    chunk_data,
    chunk_records,
    entry_of,
    header_of,
    metadata_of,
    schema_of,
    summary_of,
    unpacked_zstd,
)

LIBRARY = "crosspih recorder"  # whose chunks all carry a CRC
DEFINITIONS = "channels"  # the attachment in which the recorder repeats schemas and channels
_BEGINS = re.compile(rb"[\x06\x09\x0c](?=[\s\S]{4}\x00{4})|\x0f\x04\x00{7}")
_BARE: dict[int, Callable[[bytes], Schema | Channel | Entry]] = {
    SCHEMA: schema_of,
    CHANNEL: channel_of,
    MESSAGE: entry_of,
}
_PRIVATE = 0x80  # opcodes from here on are private to the program that wrote them


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes [offset, end) that are no intact record; `torn` if no intact record follows."""

    offset: int
    end: int
    why: str
    torn: bool

    def __str__(self) -> str:
        what = "torn off" if self.torn else f"{self.end - self.offset} bytes damaged"
        return f"{what} at byte {self.offset}: {self.why}"


@dataclass(frozen=True, slots=True)
class Whole:
    """An intact record: its content, None if it is not used here. `records` are those of a chunk."""

    offset: int
    end: int
    content: Metadata | Attachment | Schema | Channel | Entry | None = None
    records: tuple[Schema | Channel | Entry, ...] = ()
    data_end: bool = False


class Scan:
    """One file's bytes. `definitions` are those protected by a checksum outside the chunks; `summary` is the file's."""

    def __init__(self, data: mmap.mmap | bytes) -> None:
        self._data = data
        self.size = len(data)
        self.is_mcap = MAGIC.startswith(data[: len(MAGIC)])
        self.summary: Summary | None = None
        if self.size > len(MAGIC):
            with memoryview(data) as view:
                self.summary = summary_of(view)
        self.definitions = Definitions()
        self.ended = False  # the walk came to the end of the data
        self._unchecked = False
        self._records_end = self.size if self.summary is None else self.summary.start

    def __iter__(self) -> Iterator[Whole | Damage]:
        at = len(MAGIC) if self._data[: len(MAGIC)] == MAGIC else 0
        checked = at  # verified by a checksum up to here; after it, a wrong length may have led the walk too far
        while at < self._records_end:
            try:
                found = self._at(at)
            except Malformed as error:
                after = self._resume(checked)
                end = self._records_end if after is None else after.offset
                at = at if at < end else checked
                # a valid summary follows, so the file is not torn here
                yield Damage(at, end, str(error), after is None and self.summary is None)
                if after is None:
                    return
                found = after
            yield found
            at = found.end
            if found.records or found.content is not None:
                checked = at
            if found.data_end:
                self.ended = True
                if self.summary is None:
                    why = "the index at its end is not whole; no message is lost by that"
                    yield Damage(at, self.size, why, False)
                return

    def _resume(self, begin: int) -> Whole | None:
        """The next record after damage that a checksum confirms."""
        at = begin
        while (match := _BEGINS.search(self._data, at, self._records_end)) is not None:
            try:
                return self._at(match.start(), resuming=True)
            except Malformed:
                at = match.start() + 1
        return None

    def _at(self, at: int, resuming: bool = False) -> Whole:
        if at + FRAME.size > self._records_end:
            raise Malformed("a record without its length")
        opcode, length = FRAME.unpack_from(self._data, at)
        begin = at + FRAME.size
        end = begin + length
        if end > self._records_end:
            raise Malformed("a record that is longer than the file")
        if opcode == CHUNK:
            return self._chunk(at, begin, end, resuming)
        if opcode == METADATA:
            return Whole(at, end, metadata_of(self._data[begin:end]))
        if opcode == ATTACHMENT:
            return self._attachment(at, begin, end)
        if opcode == DATA_END and length == 4:
            if resuming and (self.summary is None or end != self._records_end):
                raise Malformed("an end that may be noise")
            return Whole(at, end, data_end=True)
        if opcode == MESSAGE_INDEX:
            if length < 6 or int.from_bytes(self._data[begin + 2 : begin + 6], "little") != length - 6:
                raise Malformed("an index of another length than it says")
            return Whole(at, end)
        if opcode == HEADER:
            self._unchecked = header_of(self._data[begin:end]) != LIBRARY
            return Whole(at, end)
        if opcode >= _PRIVATE and self._unchecked:
            return Whole(at, end)
        if self._unchecked and opcode in (SCHEMA, CHANNEL, MESSAGE):
            return Whole(at, end, _BARE[opcode](self._data[begin:end]))
        raise Malformed(f"no record begins here (opcode 0x{opcode:02x})")

    def _chunk(self, at: int, begin: int, end: int, resuming: bool) -> Whole:
        # cheap checks without a copy come first: random bytes often look like the start of a record
        if end - begin < CHUNK_HEAD.size + 8:
            raise Malformed("a chunk without its head")
        _, _, size, _, named = CHUNK_HEAD.unpack_from(self._data, begin)
        packed = end - begin - CHUNK_HEAD.size - named - 8
        if named > 16 or size > MAX_BYTES or packed < 0:
            raise Malformed("a chunk's head that cannot be")
        where = begin + CHUNK_HEAD.size + named
        if int.from_bytes(self._data[where : where + 8], "little") != packed:
            raise Malformed("a chunk of another length than it says")
        data = chunk_data(self._data[begin:end], self._unchecked and not resuming)
        return Whole(at, end, records=tuple(chunk_records(data)))

    def _attachment(self, at: int, begin: int, end: int) -> Whole:
        return Whole(at, end, attachment_of(self._data[begin:end]))

    def learn_definitions(self) -> Definitions:
        """Collect the schemas and channels that the summary and the recorder's attachments repeat, in a separate walk
        that opens no chunk. So a damaged chunk does not make the later messages unreadable."""
        if self.summary is not None and self.summary.definitions.channels:
            self.definitions = self.summary.definitions
            return self.definitions
        name = DEFINITIONS.encode()
        at = 0
        pattern = re.compile(re.escape(len(name).to_bytes(4, "little") + name))
        while (match := pattern.search(self._data, at)) is not None:
            at = match.end()
            offset = match.start() - 16 - FRAME.size
            try:
                if offset < 0 or self._data[offset] != ATTACHMENT:
                    continue
                found = self._at(offset).content
            except Malformed:
                continue
            if isinstance(found, Attachment):
                for record in repeated_definitions(found):
                    self.definitions.add(record)
        return self.definitions


def repeated_definitions(attachment: Attachment) -> tuple[Schema | Channel, ...]:
    """The schemas and channels in an attachment of the recorder; none where it is another one."""
    if attachment.name != DEFINITIONS:
        return ()
    try:
        data = unpacked_zstd(attachment.data, MAX_BYTES >> 4)
        return tuple(record for record in chunk_records(data) if not isinstance(record, Entry))
    except (zstandard.ZstdError, Malformed):
        return ()


@contextmanager
def scanning(path: Path) -> Iterator[Scan]:
    """A scan of a file. Raises OSError."""
    require_regular(path)
    with path.open("rb") as stream:
        if path.stat().st_size == 0:
            yield Scan(b"")
            return
        mapped = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        try:
            yield Scan(mapped)
        finally:
            mapped.close()
