"""MCAP's records, read strictly: a record is exactly what its length says, or it is malformed.

Format: https://mcap.dev/spec. In a damaged file only data with a checksum is trusted: a chunk's, an attachment's or the
summary's CRC, or the seal of a metadata record.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import zstandard

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07
ATTACHMENT, STATISTICS, METADATA, DATA_END = 0x09, 0x0B, 0x0C, 0x0F
FRAME = struct.Struct("<BQ")  # opcode, length of what follows
CHUNK_HEAD = struct.Struct("<QQQII")  # start, end, uncompressed size, its CRC, length of the compression's name
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_FOOTER = struct.Struct("<QQI")
MAX_BYTES = 1 << 30  # of a chunk, uncompressed
SEAL = "crc32"


class Malformed(ValueError):
    """Bytes that are not a valid record."""


@dataclass(frozen=True, slots=True)
class Schema:
    """What the messages of a channel look like."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Channel:
    """A key of the bus."""

    id: int
    topic: str
    encoding: str
    schema_id: int
    metadata: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Entry:
    """One message as it lies in a chunk: times in ns, the log time of the cell's clock."""

    channel_id: int
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Metadata:
    """Information about the file. `sealed` says whether it carries a checksum that detects any change."""

    name: str
    entries: dict[str, str]
    sealed: bool


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file within the file."""

    log_time: int
    create_time: int
    name: str
    media_type: str
    data: bytes


@dataclass(slots=True)
class Definitions:
    """Schemas and channels by their numbers; a number means the same throughout a file, so the first one counts."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def add(self, record: Schema | Channel) -> None:
        """Add a definition."""
        if isinstance(record, Schema):
            self.schemas.setdefault(record.id, record)
        else:
            self.channels.setdefault(record.id, record)


class _Fields:
    """Reads one field after the other; raises Malformed when the record has too few bytes."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def number(self, size: int) -> int:
        return int.from_bytes(self.raw(size), "little")

    def raw(self, size: int) -> bytes:
        end = self._at + size
        if end > len(self._data):
            raise Malformed("a field is longer than its record")
        piece = self._data[self._at : end]
        self._at = end
        return piece

    def text(self) -> str:
        try:
            return self.raw(self.number(4)).decode()
        except UnicodeDecodeError:
            raise Malformed("text that is not UTF-8") from None

    def entries(self) -> dict[str, str]:
        end = self.number(4) + self._at
        found: dict[str, str] = {}
        while self._at < end:
            name = self.text()
            found[name] = self.text()
        if self._at != end:
            raise Malformed("a map of another length than it says")
        return found

    def end(self) -> None:
        if self._at != len(self._data):
            raise Malformed("a record of another length than its fields")


def schema_of(content: bytes) -> Schema:
    """A Schema record. Raises Malformed."""
    fields = _Fields(content)
    found = Schema(fields.number(2), fields.text(), fields.text(), fields.raw(fields.number(4)))
    fields.end()
    return found


def channel_of(content: bytes) -> Channel:
    """A Channel record. Raises Malformed."""
    fields = _Fields(content)
    number, schema_id = fields.number(2), fields.number(2)
    found = Channel(number, fields.text(), fields.text(), schema_id, fields.entries())
    fields.end()
    return found


def entry_of(content: bytes) -> Entry:
    """A Message record. Raises Malformed."""
    if len(content) < _MESSAGE_HEAD.size:
        raise Malformed("a message without its head")
    channel, sequence, log_time, publish_time = _MESSAGE_HEAD.unpack_from(content)
    return Entry(channel, sequence, log_time, publish_time, content[_MESSAGE_HEAD.size :])


def header_of(content: bytes) -> str:
    """A Header record: the library that wrote the file. Raises Malformed."""
    fields = _Fields(content)
    fields.text()
    library = fields.text()
    fields.end()
    return library


def metadata_of(content: bytes) -> Metadata:
    """A Metadata record, without its seal. Raises Malformed, also where the seal does not fit."""
    fields = _Fields(content)
    name, entries = fields.text(), fields.entries()
    fields.end()
    seal = entries.pop(SEAL, None)
    if seal is not None and seal != seal_of(name, entries):
        raise Malformed(f"metadata {name}: its check fails")
    return Metadata(name, entries, seal is not None)


def seal_of(name: str, entries: Mapping[str, str]) -> str:
    """The checksum of a metadata record, for which MCAP has none: CRC-32 of its name and its entries in order."""
    total = zlib.crc32(name.encode())
    for pair in sorted(entries.items()):
        for text in pair:
            raw = text.encode()
            total = zlib.crc32(raw, zlib.crc32(struct.pack("<I", len(raw)), total))
    return f"{total:08x}"


def sealed(name: str, entries: Mapping[str, str]) -> dict[str, str]:
    """The entries with their seal."""
    return {**entries, SEAL: seal_of(name, entries)}


def attachment_of(content: bytes) -> Attachment:
    """An Attachment record. Raises Malformed, also where its CRC does not fit."""
    fields = _Fields(content)
    log_time, create_time = fields.number(8), fields.number(8)
    name, media_type, data = fields.text(), fields.text(), fields.raw(fields.number(8))
    crc = fields.number(4)
    fields.end()
    if crc != 0 and crc != zlib.crc32(content[:-4]):
        raise Malformed(f"attachment {name}: its check fails")
    return Attachment(log_time, create_time, name, media_type, data)


def chunk_data(content: bytes, unchecked: bool) -> bytes:
    """What a Chunk record holds, decompressed and checked; one without a CRC passes only where `unchecked`.

    Raises Malformed.
    """
    if len(content) < CHUNK_HEAD.size:
        raise Malformed("a chunk without its head")
    _, _, size, crc, named = CHUNK_HEAD.unpack_from(content)
    fields = _Fields(content[CHUNK_HEAD.size - 4 :])
    try:
        compression = fields.text()
        packed = fields.raw(fields.number(8))
        fields.end()
    except Malformed:
        raise Malformed(f"a chunk of another length than its fields ({named} bytes of name)") from None
    if size > MAX_BYTES:
        raise Malformed(f"a chunk of {size} bytes")
    data = _unpacked(compression, packed, size)
    if len(data) != size:
        raise Malformed(f"a chunk of {len(data)} bytes that says {size}")
    if crc == 0 and not unchecked:
        raise Malformed("a chunk without its check")
    if crc != 0 and crc != zlib.crc32(data):
        raise Malformed("a chunk whose check fails")
    return data


def unpacked_zstd(packed: bytes, most: int) -> bytes:
    """Unpack one zstd frame of `most` bytes at most. Raises ZstdError, and Malformed for a frame that declares more:
    zstandard trusts the declared size despite `max_output_size`, and a damaged or hostile header may ask for
    gigabytes."""
    if zstandard.frame_content_size(packed) > most:
        raise Malformed(f"packed bytes that stand for more than {most}")
    return zstandard.ZstdDecompressor().decompress(packed, max_output_size=most)


def _unpacked(compression: str, packed: bytes, size: int) -> bytes:
    if compression == "":
        return packed
    try:
        if compression == "zstd":
            return unpacked_zstd(packed, size)
        if compression == "lz4":
            import lz4.frame

            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError, ValueError) as error:
        raise Malformed(f"a chunk that does not unpack ({error})") from None
    raise Malformed(f"a chunk that is packed as {compression[:20]!r}")


def chunk_records(data: bytes) -> Iterator[Schema | Channel | Entry]:
    """The records within a chunk's data. Raises Malformed."""
    at, size = 0, len(data)
    while at < size:
        if at + FRAME.size > size:
            raise Malformed("a chunk that ends within a record")
        opcode, length = FRAME.unpack_from(data, at)
        begin = at + FRAME.size
        at = begin + length
        if at > size:
            raise Malformed("a record that is longer than its chunk")
        if opcode == MESSAGE:
            yield entry_of(data[begin:at])
        elif opcode == SCHEMA:
            yield schema_of(data[begin:at])
        elif opcode == CHANNEL:
            yield channel_of(data[begin:at])


@dataclass(frozen=True, slots=True)
class Summary:
    """The verified summary of a finished file: every definition, and the number of messages written."""

    definitions: Definitions
    messages: int | None
    start: int


def summary_of(data: bytes | memoryview) -> Summary | None:
    """The summary in a file's bytes; None if it has none or its checksum is wrong."""
    foot = len(data) - len(MAGIC) - _FOOTER.size - FRAME.size
    if foot < len(MAGIC) or bytes(data[-len(MAGIC) :]) != MAGIC or FRAME.unpack_from(data, foot) != (FOOTER, 20):
        return None
    start, _, crc = _FOOTER.unpack_from(data, foot + FRAME.size)
    if start == 0:
        return Summary(Definitions(), None, foot)
    if not len(MAGIC) <= start <= foot:
        return None
    if crc != 0 and crc != zlib.crc32(data[start : foot + FRAME.size + 16]):
        return None
    definitions, count, at = Definitions(), None, start
    try:
        while at < foot:
            opcode, length = FRAME.unpack_from(data, at)
            content = bytes(data[at + FRAME.size : at + FRAME.size + length])
            if opcode == SCHEMA:
                definitions.add(schema_of(content))
            elif opcode == CHANNEL:
                definitions.add(channel_of(content))
            elif opcode == STATISTICS:
                count = _Fields(content).number(8)
            at += FRAME.size + length
    except (Malformed, struct.error):
        return None
    return Summary(definitions, count, start)
